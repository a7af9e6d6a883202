# SPDX-License-Identifier: Apache-2.0
"""The panel of the history: its events come from all other panels."""

from merlin_monitor.listeners.panel import Panel


class HistoryPanel(Panel):
    """The events of the run."""

    name, title, place, width = "history", "History", 80, 5

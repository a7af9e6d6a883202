# SPDX-License-Identifier: Apache-2.0
"""The monitor's panel of the restaurant: tables with what they want, and the clients at the entrance."""

from merlin_monitor.listeners.panel import Panel


class TablesPanel(Panel):
    """Its script draws what the knowledge base knows; it follows nothing else."""

    name, title, place = "tables", "Tables and guests", 40
    script = "package://merlin_restaurant/web/tables.js"

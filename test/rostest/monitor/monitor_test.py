#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""The monitor's page in a real browser: what it shows, and what operators do with it."""

from monitor_shown_cases import ShownCases
from monitor_stop_cases import StopCases

import rostest
from merlin_test.topic_links import init_node


class MonitorPage(ShownCases, StopCases):
    """All cases over one MERLIN, in the order of their numbers."""


if __name__ == "__main__":
    init_node("monitor_test")
    rostest.rosrun("merlin_test", "monitor", MonitorPage)

#!/usr/bin/env python3
"""The monitor's page in a real browser: what it shows, and what operators do with it."""

import rospy
from monitor_control_cases import ControlCases
from monitor_shown_cases import ShownCases

import rostest


class MonitorPage(ShownCases, ControlCases):
    """All cases over one MERLIN, in the order of their numbers."""


if __name__ == "__main__":
    rospy.init_node("monitor_test")
    rostest.rosrun("merlin_test", "monitor", MonitorPage)

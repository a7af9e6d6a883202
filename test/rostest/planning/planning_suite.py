#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""The cases of planning.test, over one start of its nodes."""

import unittest

from planner_interface_test import Planner
from planning_stages_test import Apart, Together
from rosplan_launch_files_test import RosplanLaunchFilesTest
from tolerant_stages_test import TolerantStagesTest

import rostest
from merlin_test.topic_links import init_node

CASES = (Apart, Planner, RosplanLaunchFilesTest, TolerantStagesTest, Together)


def suite():
    return unittest.TestSuite(map(unittest.defaultTestLoader.loadTestsFromTestCase, CASES))


if __name__ == "__main__":
    init_node("planning_test")
    rostest.rosrun("merlin_test", "planning", "__main__.suite")

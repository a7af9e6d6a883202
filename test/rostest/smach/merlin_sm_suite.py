#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""The cases of merlin_sm.test, over one start of its nodes."""

import unittest

from arm_test import Arm
from merlin_sm_test import MerlinSMSuite

import rostest
from merlin_test.topic_links import init_node

CASES = (Arm, MerlinSMSuite)


def suite():
    return unittest.TestSuite(map(unittest.defaultTestLoader.loadTestsFromTestCase, CASES))


if __name__ == "__main__":
    init_node("merlin_sm_test")
    rostest.rosrun("merlin_test", "merlin_sm", "__main__.suite")

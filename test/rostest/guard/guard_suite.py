#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""The cases of guard.test, over one start of its nodes."""

import unittest

from guard_drives_test import GuardDrives
from guard_start_test import GuardStart
from guard_test import Guard

import rostest
from merlin_test.topic_links import init_node

CASES = (GuardDrives, GuardStart, Guard)


def suite():
    return unittest.TestSuite(map(unittest.defaultTestLoader.loadTestsFromTestCase, CASES))


if __name__ == "__main__":
    init_node("guard_test")
    rostest.rosrun("merlin_test", "guard", "__main__.suite")

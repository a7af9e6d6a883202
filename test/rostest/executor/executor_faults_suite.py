#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""The cases of executor_faults.test, over one start of its nodes."""

import unittest

from executor_faults_test import Faults, OtherLimits
from executor_restart_test import Restart, RestartWithoutFile

import rostest
from merlin_test.topic_links import init_node

CASES = (Faults, OtherLimits, Restart, RestartWithoutFile)


def suite():
    return unittest.TestSuite(map(unittest.defaultTestLoader.loadTestsFromTestCase, CASES))


if __name__ == "__main__":
    init_node("executor_faults_test")
    rostest.rosrun("merlin_test", "executor_faults", "__main__.suite")

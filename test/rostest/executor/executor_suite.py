#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""The cases of executor.test, over one start of its nodes."""

import unittest

from cancel_stress_test import Stress
from exchange_test import Exchange
from executor_test import Executor
from goal_dispatcher_test import GoalDispatchers
from rviz_test import Rviz

import rostest
from merlin_test.topic_links import init_node

# The stress first: what the others watch costs time at each of its cycles.
CASES = (Stress, Exchange, Executor, GoalDispatchers, Rviz)


def suite():
    return unittest.TestSuite(map(unittest.defaultTestLoader.loadTestsFromTestCase, CASES))


if __name__ == "__main__":
    init_node("executor_test")
    rostest.rosrun("merlin_test", "executor", "__main__.suite")

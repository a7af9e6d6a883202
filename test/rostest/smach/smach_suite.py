#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""The cases of smach.test, over one start of its nodes."""

import unittest

from arm_test import Arm
from merlin_sm_test import MerlinSMSuite
from smach_action_server_test import Wrapper
from smach_action_states_test import ActionStates
from smach_introspection_test import Introspection
from smach_states_test import States

import rostest
from merlin_test.topic_links import init_node

CASES = (Arm, MerlinSMSuite, States, ActionStates, Introspection, Wrapper)


def suite():
    return unittest.TestSuite(map(unittest.defaultTestLoader.loadTestsFromTestCase, CASES))


if __name__ == "__main__":
    init_node("smach_test")
    rostest.rosrun("merlin_test", "smach", "__main__.suite")

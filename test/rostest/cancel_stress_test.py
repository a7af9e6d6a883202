#!/usr/bin/env python3
"""Hundreds of cancels and interruptions at random moments leave everything as it has to be."""

import unittest

import rospy

import rostest
from merlin_executor.testing.cancel_stress import CancelStress
from merlin_executor.testing.process_usage import usage_of_nodes

GOALS = [f"(checked {poi})" for poi in ("kitchen", "bathroom", "dorm_room", "main_door")]
WARM_UP = 20  # cycles until every connection has been made once


class Stress(unittest.TestCase):
    def test_random_cancels_and_interruptions(self):
        stress = CancelStress(GOALS, seed=7, longest=0.4)
        stress.run(WARM_UP)
        before = usage_of_nodes()
        stress.run(rospy.get_param("~cycles"))
        after = usage_of_nodes()
        self.assertGreater(len(before), 4)
        grown = {
            name: (before[name], after[name])
            for name in before
            if name in after and after[name].threads > before[name].threads + 4
        }
        self.assertEqual(grown, {}, "threads were left behind")


if __name__ == "__main__":
    rospy.init_node("cancel_stress_test")
    rostest.rosrun("merlin_test", "cancel_stress", Stress)

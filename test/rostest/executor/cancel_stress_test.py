#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""A hundred cancels and interruptions at random moments leave everything as it has to be; soak has more."""

import sys
import time
import unittest
from pathlib import Path

import rospy

import rostest
from merlin_test import LONG

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "bench"))  # not installed

from stress.cancel_stress import CancelStress
from stress.process_usage import usage_of_nodes

from merlin_test.topic_links import init_node

GOALS = [f"(checked {poi})" for poi in ("kitchen", "bathroom", "dorm_room", "main_door")]
WARM_UP = 20  # cycles until every connection has been made once


class Stress(unittest.TestCase):
    def test_random_cancels_and_interruptions(self):
        stress = CancelStress(GOALS, seed=7, longest=0.4)
        stress.run(WARM_UP)
        before = usage_of_nodes()
        stress.run(rospy.get_param("~cycles"))
        self.assertGreater(len(before), 4)
        end = time.monotonic() + LONG
        while self.grown(before):  # on a busy machine threads end late
            self.assertLess(time.monotonic(), end, f"threads were left behind: {self.grown(before)}")
            time.sleep(0.5)

    @staticmethod
    def grown(before):
        """The nodes that have more threads than before."""
        after = usage_of_nodes()
        return {
            name: (before[name], after[name])
            for name in before
            if name in after and after[name].threads > before[name].threads + 4
        }


if __name__ == "__main__":
    init_node("cancel_stress_test")
    rostest.rosrun("merlin_test", "cancel_stress", Stress)

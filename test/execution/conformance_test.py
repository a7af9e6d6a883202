#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""The conformance cases with nodes, judged by the effects that came true and by the knowledge at the end."""

import random
import re
import unittest

import rospy
from cases import CASES, failure_of, sections
from node_world import NodeWorld, named
from pddl21 import Model
from semantics import judge

import rostest
from merlin_test.topic_links import init_node

# durations compared to the plan's, and how fast the clock runs
PACES = {"planned": (lambda rng: 1.0, 10), "slow": (lambda rng: 10.0, 100), "fast": (lambda rng: 0.1, 1)}
PACES["random"] = (lambda rng: 10 ** rng.uniform(-1, 1), 10)


class Conformance(unittest.TestCase):
    """The parameters ``~kinds``, ``~cases`` (names; empty: all) and ``~paces`` say what is run."""

    @classmethod
    def setUpClass(cls):
        wanted = rospy.get_param("~cases", [])
        cls.cases = [
            named(case, number) for number, case in enumerate(CASES) if not wanted or case.name in wanted
        ]
        assert len(cls.cases) == len(wanted or CASES), wanted
        cls.world = NodeWorld(cls.cases)

    @classmethod
    def tearDownClass(cls):
        cls.world.close()

    def test_each_case_ends_as_it_has_to(self):
        for case in self.cases:
            model = Model(sections(case.domain), "", case.init, case.goal)
            for kind in rospy.get_param("~kinds"):
                with self.world.interfaces(case, kind) as interfaces:
                    for pace in rospy.get_param("~paces"):
                        with self.subTest(case=case.name, kind=kind, pace=pace):
                            try:
                                self.check(case, model, kind, pace, interfaces)
                            except AssertionError as error:  # rostest keeps the texts of subtests for itself
                                print(f"{case.name}, {kind}, {pace}: {error}", flush=True)
                                raise

    def check(self, case, model, kind, pace, interfaces):
        factor, self.world.clock.factor = PACES[pace]
        rng = random.Random(f"{case.name} {pace}")
        durations = [float(part.split()[2]) * factor(rng) for part in filter(None, case.plan.split("|"))]
        run = self.world.run(case, model, kind, interfaces, durations)
        told = f"{run.reason}\n{run.events}\n{run.state}"
        self.assertEqual(run.open, [], told)  # whatever came to no end was undone
        failure = failure_of(case, kind)
        if failure is not None:
            self.assertFalse(run.success, told)
            self.assertIn(failure, run.reason)
            return
        if not run.success:  # messages take their time, and the clock runs on
            self.assertTrue("drift" in case.expect and run.reason, told)
            return
        verdict = judge(model, run.actions, run.events)
        self.assertEqual(verdict.fault, "", told)
        self.assertTrue(model.holds(model.goal, run.state), told)
        last = max((event.time for event in run.events), default=0.0)
        if not any(timed.time > last for timed in model.timed):  # else it may have come since
            self.assertEqual(verdict.state.facts, run.state.facts, told)
            for key, value in verdict.state.values.items():
                self.assertAlmostEqual(value, run.state.values[key], msg=told)
        if kind == "simple" and "drift" in case.expect:
            return
        times = {f"{e.action}{e.kind[0]}": n for n, e in enumerate(run.events) if e.kind != "timed"}
        for first, sign, second in re.findall(r"(\d+[se])([<>])(\d+[se])", case.expect):
            self.assertEqual(times[first] < times[second], sign == "<", f"{first}{sign}{second}\n{told}")


if __name__ == "__main__":
    init_node("conformance_test")
    rostest.rosrun("merlin_test", "conformance", "__main__")

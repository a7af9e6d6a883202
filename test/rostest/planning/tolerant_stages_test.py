# SPDX-License-Identifier: Apache-2.0
"""What ROSPlan takes for a success although there is nothing: only with ~strict:=false."""

import tempfile
import unittest

import rospy
from rosplan_dispatch_msgs.msg import EsterelPlan, EsterelPlanEdge
from rosplan_dispatch_msgs.srv import ParsingService, PlanningService
from std_msgs.msg import String
from std_srvs.srv import Empty

from merlin_test import LONG

PLAN = "0.000: (go hall kitchen)  [1.000]\n1.001: (go kitchen cellar)  [1.000]\n"
CONDITION, START_END = EsterelPlanEdge.CONDITION_EDGE, EsterelPlanEdge.START_END_ACTION_EDGE


def call(name, kind, *args):
    rospy.wait_for_service(name, LONG)
    return rospy.ServiceProxy(name, kind)(*args)


class TolerantStagesTest(unittest.TestCase):
    def test_parsing_before_any_plan(self):
        with self.assertRaisesRegex(rospy.ServiceException, "no plan was received"):
            call("stages/strict_parsing_interface/parse_plan", Empty)
        call("stages/tolerant_parsing_interface/parse_plan", Empty)

    def test_a_plan_file_that_is_missing_is_an_empty_plan(self):
        service = "parsing_interface/parse_plan_from_file"
        self.assertFalse(call(f"stages/strict_{service}", ParsingService, "/no/such/plan.pddl").plan_parsed)
        self.assertTrue(call(f"stages/tolerant_{service}", ParsingService, "/no/such/plan.pddl").plan_parsed)
        plan = rospy.wait_for_message("stages/tolerant_parsing_interface/complete_plan", EsterelPlan, LONG)
        self.assertEqual([node.name for node in plan.nodes], ["plan_start"])

    def graph(self, parser):
        with tempfile.NamedTemporaryFile("w", suffix=".pddl") as file:
            file.write(PLAN)
            file.flush()
            self.assertTrue(call(f"{parser}/parse_plan_from_file", ParsingService, file.name).plan_parsed)
        return rospy.wait_for_message(f"{parser}/complete_plan", EsterelPlan, LONG)

    def test_the_graph_of_plain_actions(self):
        graph = self.graph("stages/walk_parsing_interface")
        edges = [
            (e.edge_id, e.edge_name, e.edge_type, e.source_ids[0], e.sink_ids[0], e.signal_type)
            for e in graph.edges
        ]
        expected = [(CONDITION, 0, 1), (START_END, 1, 2), (CONDITION, 0, 2)]
        expected += [(CONDITION, 1, 3), (START_END, 3, 4), (CONDITION, 0, 4)]
        self.assertEqual(edges, [(i, f"edge_{i}", *edge, 0) for i, edge in enumerate(expected)])
        strict = self.graph("stages/strict_parsing_interface")
        pairs = [(edge.source_ids[0], edge.sink_ids[0]) for edge in strict.edges]
        self.assertIn((2, 3), pairs)  # the second waits for the end of the first
        self.assertNotIn((1, 3), pairs)

    def test_without_a_knowledge_base_the_answer_does_not_wait_for_it(self):
        output = rospy.Publisher(
            "stages/tolerant_parsing_interface/planner_output", String, queue_size=1, latch=True
        )
        output.publish(PLAN)
        # a call whose plan is still on its way finds nothing to do
        reasons = []
        while not reasons:
            try:
                call("stages/tolerant_parsing_interface/parse_plan", Empty)
            except rospy.ServiceException as error:
                reasons.append(str(error))
        self.assertIn("rosplan_knowledge_base", reasons[0])
        self.assertIn("given up after", reasons[0])

    def test_a_problem_file_that_is_missing(self):
        domain = rospy.get_param("stages/rosplan_planner_interface/domain_path")
        service = "planner_interface/planning_server_params"
        for paths in ((domain, "/no/such.pddl"), ("/no/such.pddl", "/no/such.pddl")):
            self.assertFalse(
                call(f"stages/strict_{service}", PlanningService, *paths, "", "", False).plan_found
            )
            self.assertTrue(
                call(f"stages/tolerant_{service}", PlanningService, *paths, "", "", False).plan_found
            )
        broken = (domain, __file__, "", "", False)
        self.assertFalse(
            call(f"stages/tolerant_{service}", PlanningService, *broken).plan_found, "not tolerated"
        )

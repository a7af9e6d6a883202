#!/usr/bin/env python3
"""What ROSPlan takes for a success although there is nothing: only with ~strict:=false."""

import unittest

import rospy
from rosplan_dispatch_msgs.msg import EsterelPlan
from rosplan_dispatch_msgs.srv import ParsingService, PlanningService
from std_srvs.srv import Empty

import rostest

LONG = 60.0


def call(name, kind, *args):
    rospy.wait_for_service(name, LONG)
    return rospy.ServiceProxy(name, kind)(*args)


class TolerantStagesTest(unittest.TestCase):
    def test_parsing_before_any_plan(self):
        with self.assertRaisesRegex(rospy.ServiceException, "no plan was received"):
            call("strict_parsing_interface/parse_plan", Empty)
        call("tolerant_parsing_interface/parse_plan", Empty)

    def test_a_plan_file_that_is_missing_is_an_empty_plan(self):
        service = "parsing_interface/parse_plan_from_file"
        self.assertFalse(call(f"strict_{service}", ParsingService, "/no/such/plan.pddl").plan_parsed)
        self.assertTrue(call(f"tolerant_{service}", ParsingService, "/no/such/plan.pddl").plan_parsed)
        plan = rospy.wait_for_message("tolerant_parsing_interface/complete_plan", EsterelPlan, LONG)
        self.assertEqual([node.name for node in plan.nodes], ["plan_start"])

    def test_a_problem_file_that_is_missing(self):
        domain = rospy.get_param("domain_path")
        service = "planner_interface/planning_server_params"
        for paths in ((domain, "/no/such.pddl"), ("/no/such.pddl", "/no/such.pddl")):
            self.assertFalse(call(f"strict_{service}", PlanningService, *paths, "", "", False).plan_found)
            self.assertTrue(call(f"tolerant_{service}", PlanningService, *paths, "", "", False).plan_found)
        broken = (domain, __file__, "", "", False)
        self.assertFalse(call(f"tolerant_{service}", PlanningService, *broken).plan_found, "not tolerated")


if __name__ == "__main__":
    rospy.init_node("tolerant_stages_test")
    rostest.rosrun("merlin_test", "tolerant_stages", TolerantStagesTest)

# SPDX-License-Identifier: Apache-2.0
"""Process: prints what a robot's Executor executes, in lines of JSON. It knows nothing of the fleet.

The command {"forget": true} makes every room unchecked again.
"""

import sys
from pathlib import Path
from typing import Dict

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import rospy
from actionlib_msgs.msg import GoalStatus, GoalStatusArray
from chaos.under_test.child import Reporter, commands
from merlin_msgs.msg import ExecuteActionGoal, ExecuteActionResult

from merlin_executor.executor_client import outcome_name
from merlin_planning.knowledge_client import KnowledgeError
from merlin_ros.service_proxy import ServiceError
from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant

ACTION = "merlin/execute"


class Witness:
    """Reports begins and ends."""

    def __init__(self, report: Reporter) -> None:
        self._report = report
        self._goals: Dict[str, str] = {}
        self._begun: Dict[str, bool] = {}
        rospy.Subscriber(f"{ACTION}/goal", ExecuteActionGoal, self._take_goal)
        rospy.Subscriber(f"{ACTION}/status", GoalStatusArray, self._take_status)
        rospy.Subscriber(f"{ACTION}/result", ExecuteActionResult, self._take_result)

    def _take_goal(self, message: ExecuteActionGoal) -> None:
        self._goals[message.goal_id.id] = " ".join(message.goal.goals)

    def _take_status(self, message: GoalStatusArray) -> None:
        for status in message.status_list:
            name = status.goal_id.id
            if status.status == GoalStatus.ACTIVE and name in self._goals and name not in self._begun:
                self._begun[name] = True
                self._report("begun", goal=self._goals[name])

    def _take_result(self, message: ExecuteActionResult) -> None:
        goal = self._goals.pop(message.status.goal_id.id, None)
        if goal is not None:
            self._report("ended", goal=goal, outcome=outcome_name(message.result.outcome))


if __name__ == "__main__":
    rospy.init_node("fleet_witness")
    reporter = Reporter()
    Witness(reporter)
    reporter("there")
    assistant = MerlinROSPlanAssistant()
    for _ in commands(sys.stdin):
        try:
            assistant.remove_facts(assistant.facts("checked"))
        except (ServiceError, KnowledgeError) as error:
            reporter("forgot nothing", error=str(error))
        else:
            reporter("forgot")

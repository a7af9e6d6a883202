# SPDX-License-Identifier: Apache-2.0
"""The cores run without ROS: what they copy of a message has the numbers of the message."""

import pytest
from actionlib_msgs.msg import GoalStatus
from merlin_msgs.msg import DispatchStatus, ExecuteGoal, GuardStatus, PlannerStatus, SimPerson
from merlin_msgs.srv import ApplyEffectsRequest
from rosplan_dispatch_msgs.msg import ActionFeedback, EsterelPlanEdge, EsterelPlanNode

from merlin_actions.core.ending import Closing
from merlin_executor.core.request_limits import ON_CLIENT_LOST, ON_INTERRUPT
from merlin_guard.motion_permit import GuardState
from merlin_planning.dispatch_progress import DispatchAnswer
from merlin_ros.work.goal_end import GoalEnd
from merlin_rosplan.dispatch.dispatch_environment import DispatchState, FeedbackStatus
from merlin_rosplan.dispatch.plan_graph import EdgeType, NodeType
from merlin_rosplan.planning.planning_outcome import PlannerState
from merlin_sim.people.walkers import WalkState


@pytest.mark.parametrize(
    ("copied", "message", "others"),
    [
        (Closing, ApplyEffectsRequest, {}),
        (GuardState, GuardStatus, {}),
        (
            DispatchAnswer,
            ActionFeedback,
            {
                "TAKEN": "ACTION_ENABLED",
                "SUCCEEDED": "ACTION_SUCCEEDED_TO_GOAL_STATE",
                "FAILED": "ACTION_FAILED",
            },
        ),
        (GoalEnd, GoalStatus, {}),
        (DispatchState, DispatchStatus, dict.fromkeys(("SUCCEEDED", "FAILED", "CANCELLED"))),
        (
            FeedbackStatus,
            ActionFeedback,
            {
                **{state.name: f"ACTION_{state.name}" for state in FeedbackStatus},
                "SUCCEEDED": "ACTION_SUCCEEDED_TO_GOAL_STATE",
            },
        ),
        (
            EdgeType,
            EsterelPlanEdge,
            {
                "CONDITION": "CONDITION_EDGE",
                "START_END": "START_END_ACTION_EDGE",
                "INTERFERENCE": "INTERFERENCE_EDGE",
            },
        ),
        (NodeType, EsterelPlanNode, {}),
        (PlannerState, PlannerStatus, {}),
        (WalkState, SimPerson, {}),
    ],
)
def test_each_number_is_that_of_the_message(copied, message, others):
    """Under another name where `others` has one; None: the message has no such constant."""
    names = {member: others.get(member.name, member.name) for member in copied}
    wanted = {name: member.value for member, name in names.items() if name is not None}
    assert wanted == {name: getattr(message, name) for name in wanted}


@pytest.mark.parametrize("choices", [ON_INTERRUPT, ON_CLIENT_LOST])
def test_each_choice_has_the_number_of_the_message(choices):
    assert choices == {name: getattr(ExecuteGoal, name) for name in choices}

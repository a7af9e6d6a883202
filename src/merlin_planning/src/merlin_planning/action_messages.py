# SPDX-License-Identifier: Apache-2.0
"""Dispatched actions, their answers and that of the dispatcher, to and from ROSPlan's messages."""

from typing import Dict, Optional, Tuple

import rospy
from actionlib_msgs.msg import GoalStatus
from merlin_msgs.msg import RunningAction
from rosplan_dispatch_msgs.msg import ActionDispatch, ActionFeedback
from rosplan_dispatch_msgs.srv import DispatchServiceResponse

from merlin_planning.dispatch_progress import (
    CANCEL_ACTION,
    PART,
    Action,
    DispatchAnswer,
    Ground,
    Reply,
    ground,
)
from merlin_ros.actions.client_goal import ClientGoal
from merlin_ros.service_proxy import ServiceError, ServiceUnavailable

OWN_MARK = "dispatcher"  # key in the information of feedback that a dispatcher published itself


def ground_action(dispatch: ActionDispatch) -> Ground:
    """The action that is dispatched, for comparison."""
    return ground(dispatch.name, [entry.value for entry in dispatch.parameters])


def dispatched_action(dispatch: ActionDispatch) -> Action:
    """An action that is dispatched now."""
    now = rospy.Time.now()
    message = RunningAction(
        action_id=dispatch.action_id,
        plan_id=dispatch.plan_id,
        name=dispatch.name,
        parameters=dispatch.parameters,
        dispatched=now,
    )
    arguments = tuple(entry.value for entry in dispatch.parameters)
    ends = now.to_sec() + dispatch.duration
    return Action(dispatch.action_id, dispatch.plan_id, dispatch.name, arguments, message, ends)


def cancel_of(action: Action) -> ActionDispatch:
    """The cancel of an action."""
    return ActionDispatch(
        action_id=action.id, plan_id=action.plan_id, name=CANCEL_ACTION, parameters=action.message.parameters
    )


def answer_in(feedback: ActionFeedback) -> Optional[Tuple[DispatchAnswer, Dict[str, str]]]:
    """What an action interface says, and its information; None: it says nothing, or a dispatcher spoke."""
    information = {entry.key: entry.value for entry in feedback.information}
    if feedback.status not in tuple(DispatchAnswer) or OWN_MARK in information:
        return None
    return DispatchAnswer(feedback.status), information


def reply_of(answer: object, dispatcher: str, begun: bool) -> Reply:
    """Reads it.

    :param answer: the goal that has ended, the response of the service, or what the call has raised.
    :param dispatcher: its name.
    :param begun: whether an action of the dispatch was seen.
    """
    if isinstance(answer, ClientGoal):
        if answer.status == GoalStatus.REJECTED:
            return Reply(refused=answer.text)
        if answer.status != GoalStatus.LOST:
            return Reply(achieved=answer.result.goal_achieved)
        answer = ServiceUnavailable(answer.text)
    if isinstance(answer, DispatchServiceResponse):
        return Reply(achieved=answer.goal_achieved)
    if not isinstance(answer, ServiceError):
        return Reply(gone=f"the call of {PART} failed: {type(answer).__name__}: {answer}")
    if not isinstance(answer, ServiceUnavailable):
        return Reply(refused=str(answer))
    if begun:
        return Reply(gone=f"{PART} {dispatcher} ended while it carried out the plan")
    return Reply(gone=f"{PART} does not answer: {answer}")

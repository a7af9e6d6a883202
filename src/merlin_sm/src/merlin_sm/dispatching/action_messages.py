"""Dispatched actions and their answers, to and from ROSPlan's messages."""

from typing import Dict, Optional, Tuple

import rospy
from merlin_msgs.msg import RunningAction
from rosplan_dispatch_msgs.msg import ActionDispatch, ActionFeedback

from merlin_sm.dispatching.progress import Action, DispatchAnswer

CANCEL_ACTION = "cancel_action"
_DISPATCHER = "dispatcher"  # key in the information of feedback that a dispatcher published itself
_ANSWERS = {
    ActionFeedback.ACTION_ENABLED: DispatchAnswer.TAKEN,
    ActionFeedback.ACTION_SUCCEEDED_TO_GOAL_STATE: DispatchAnswer.SUCCEEDED,
    ActionFeedback.ACTION_FAILED: DispatchAnswer.FAILED,
}


def dispatched_action(dispatch: ActionDispatch) -> Action:
    """An action that is dispatched now."""
    message = RunningAction(
        action_id=dispatch.action_id,
        plan_id=dispatch.plan_id,
        name=dispatch.name,
        parameters=dispatch.parameters,
        dispatched=rospy.Time.now(),
    )
    arguments = tuple(entry.value for entry in dispatch.parameters)
    return Action(dispatch.action_id, dispatch.plan_id, dispatch.name, arguments, message)


def cancel_of(action: Action) -> ActionDispatch:
    """The cancel of an action."""
    return ActionDispatch(
        action_id=action.id,
        plan_id=action.plan_id,
        name=CANCEL_ACTION,
        parameters=action.message.parameters,
    )


def answer_in(feedback: ActionFeedback) -> Optional[Tuple[DispatchAnswer, Dict[str, str]]]:
    """What an action interface says, and its information; None: it says nothing, or a dispatcher spoke."""
    answer = _ANSWERS.get(feedback.status)
    information = {entry.key: entry.value for entry in feedback.information}
    return None if answer is None or _DISPATCHER in information else (answer, information)

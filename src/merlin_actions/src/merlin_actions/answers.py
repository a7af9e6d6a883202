# SPDX-License-Identifier: Apache-2.0
"""What an action interface says of an execution, as ROSPlan's message."""

from typing import Optional

from diagnostic_msgs.msg import KeyValue
from rosplan_dispatch_msgs.msg import ActionFeedback

from merlin_actions.core.ending import Ending, information_of
from merlin_actions.core.execution import Key

#: Answers that wait for the dispatcher's connection; rospy drops the oldest of more, and says nothing.
QUEUE = 1000


def answer_of(key: Key, ending: Optional[Ending] = None) -> ActionFeedback:
    """Its answer: that it has ended; without an ending, that it is accepted."""
    feedback = ActionFeedback(plan_id=key[0], action_id=key[1], status=ActionFeedback.ACTION_ENABLED)
    if ending is not None:
        succeeded = ActionFeedback.ACTION_SUCCEEDED_TO_GOAL_STATE
        feedback.status = succeeded if ending.succeeded else ActionFeedback.ACTION_FAILED
        feedback.information = [KeyValue(name, value) for name, value in information_of(ending).items()]
    return feedback

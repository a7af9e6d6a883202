# SPDX-License-Identifier: Apache-2.0
"""What the end of a machine's goal says: at the host, which runs it, and at the bridge, which has sent it."""

from typing import NamedTuple, Optional

from merlin_actions.core.ending import GIVEN_UP, NOT_BEGUN, Ending, no_retry
from merlin_actions.core.execution import Execution
from merlin_ros.work.goal_end import GoalEnd

#: Outcome of a machine that has done its work.
SUCCEEDED = "succeeded"
#: Outcome of a machine that was stopped.
PREEMPTED = "preempted"


class MachineEnd(NamedTuple):
    """The result of a machine's goal."""

    outcome: str = ""
    """Outcome of the machine; ``given_up`` and ``not_begun`` when a state gave up."""
    reason: str = ""
    unstopped: str = ""
    """What did not stop after a cancel; empty when everything has ended."""
    about: str = ""
    """The object on account of which a state gave up."""


class GoalAnswer(NamedTuple):
    """What a host answers to a goal."""

    how: GoalEnd
    end: MachineEnd


def answer_of(end: MachineEnd, operator: str, cancel_reason: Optional[str]) -> GoalAnswer:
    """What a host answers for a run.

    :param end: how the machine ended.
    :param cancel_reason: why the goal was cancelled; None: it was not.
    """
    if end.outcome == SUCCEEDED:
        return GoalAnswer(GoalEnd.SUCCEEDED, MachineEnd(SUCCEEDED))
    if end.unstopped:
        reason = f"{end.unstopped} did not stop when {operator} was cancelled"
        return GoalAnswer(GoalEnd.ABORTED, end._replace(reason=reason))
    if cancel_reason is not None and end.outcome == PREEMPTED:
        return GoalAnswer(GoalEnd.PREEMPTED, end._replace(reason=end.reason or cancel_reason))
    reason = end.reason or f"the machine ended with {end.outcome}"
    return GoalAnswer(GoalEnd.ABORTED, end._replace(reason=reason))


def ending_of(how: GoalEnd, end: MachineEnd, execution: Execution, text: str = "") -> Ending:
    """What the end of its goal means for an execution.

    :param how: how the goal ended.
    :param end: its result; empty when it has none.
    :param text: of the goal's status, for a result without a reason.
    """
    if how is GoalEnd.SUCCEEDED:
        return Ending(True)
    if execution.cancelled.is_set() and how in (GoalEnd.PREEMPTED, GoalEnd.RECALLED):
        return Ending(False, execution.cancel_reason, how.begun)
    if how is GoalEnd.LOST:
        return Ending(False, f"the state machine of {execution.text} is gone: {text}")
    reason = end.reason or text or f"{execution.text} was {how.name.lower()} without a reason"
    begun = how.begun and end.outcome != NOT_BEGUN
    hopeless = ""
    if end.outcome in (GIVEN_UP, NOT_BEGUN):
        arguments = [parameter.value for parameter in execution.parameters]
        hopeless = no_retry(execution.dispatch.name, arguments, end.about)
    return Ending(False, reason, begun, end.unstopped, hopeless)

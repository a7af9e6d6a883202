# SPDX-License-Identifier: Apache-2.0
"""How an execution ends: its effects on the knowledge base, and the answer to the dispatcher.

And what the end of its machine's goal says: at the host, which runs it, and at the bridge, which has sent it.
"""

from enum import IntEnum
from typing import Dict, NamedTuple, Optional, Sequence, Tuple

from merlin_actions.core.execution import Execution
from merlin_pddl.plan_text import call_text
from merlin_ros.work.goal_end import GoalEnd


class Ending(NamedTuple):
    """How an execution ended: whether the action's effects came true, and if not, why."""

    succeeded: bool
    reason: str = ""
    begun: bool = True
    """False when nothing was done at all: the world is as it was before the dispatch."""
    unstopped: str = ""
    """Name of the server that did not stop after a cancel; empty when everything has ended."""
    no_retry: str = ""
    """Which actions another try cannot help, as PDDL text with ``*`` for any argument; empty: it may help."""
    robot: str = ""
    """The robot that no longer takes actions; other robots continue theirs. Empty: that is not the cause."""
    of_robot: str = ""
    """All actions of this operator by this robot, like `no_retry`; empty: there is one robot, or it left."""


def information_of(ending: Ending) -> Dict[str, str]:
    """What the feedback to a dispatcher holds beside success or failure: ``ActionFeedback.information``."""
    if ending.succeeded:
        return {}
    said = {
        "reason": ending.reason,
        "final": ending.no_retry,
        "stopped": "no" if ending.unstopped else "",
        "robot": ending.robot,
        "of_robot": ending.of_robot,
    }
    return {key: value for key, value in said.items() if value}


def no_retry(operator: str, arguments: Sequence[str], about: str) -> str:
    """The actions that can no longer help after one was given up.

    :param arguments: of that action.
    :param about: the argument on account of which it was; empty or another word: all of them.
    """
    found = about.lower() in map(str.lower, arguments)
    kept = [argument if not found or argument.lower() == about.lower() else "*" for argument in arguments]
    return call_text(operator, kept)


class Closing(IntEnum):
    """How the knowledge of an execution is closed, by its number in merlin_msgs/ApplyEffects."""

    END = 1
    """The effects came true."""
    ROLLBACK = 2
    """Never began: the earlier facts hold."""
    INTERRUPT = 3
    """Stopped while it ran: the facts that the action declares for this case hold, else the earlier ones."""


def closing_of(ending: Ending) -> Closing:
    """How the knowledge of an execution is closed."""
    if ending.succeeded:
        return Closing.END
    return Closing.INTERRUPT if ending.begun else Closing.ROLLBACK


def after_closing(ending: Ending, fault: str) -> Ending:
    """What is answered when the knowledge could not be closed.

    :param fault: why. Effects that are not in the knowledge did not come true for the rest of the plan.
    """
    why = f"{ending.reason or 'it ran'}, and the knowledge could not be updated: {fault}"
    return ending._replace(succeeded=False, reason=why)


#: Outcome of a machine that has done its work.
SUCCEEDED = "succeeded"
#: Outcome of a machine that was stopped.
PREEMPTED = "preempted"
#: Outcome of a machine, one of whose states gave up: another try cannot help.
GIVEN_UP = "given_up"
#: The same, and nothing was done before.
NOT_BEGUN = "not_begun"


class MachineEnd(NamedTuple):
    """The result of a machine's goal."""

    outcome: str = ""
    """Outcome of the machine; ``given_up`` and ``not_begun`` when a state gave up."""
    reason: str = ""
    unstopped: str = ""
    """What did not stop after a cancel; empty when everything has ended."""
    about: str = ""
    """The object on account of which a state gave up."""


def answer_of(end: MachineEnd, operator: str, cancel_reason: Optional[str]) -> Tuple[GoalEnd, MachineEnd]:
    """How the goal of a run ends, and with which result.

    :param end: how the machine ended.
    :param cancel_reason: why the goal was cancelled; None: it was not.
    """
    if end.outcome == SUCCEEDED:
        return GoalEnd.SUCCEEDED, MachineEnd(SUCCEEDED)
    if end.unstopped:
        reason = f"{end.unstopped} did not stop when {operator} was cancelled"
        return GoalEnd.ABORTED, end._replace(reason=reason)
    if cancel_reason is not None and end.outcome == PREEMPTED:
        return GoalEnd.PREEMPTED, end._replace(reason=end.reason or cancel_reason)
    return GoalEnd.ABORTED, end._replace(reason=end.reason or f"the machine ended with {end.outcome}")


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

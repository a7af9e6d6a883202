# SPDX-License-Identifier: Apache-2.0
"""How an execution ends: its effects on the knowledge base, and the answer to the dispatcher."""

from enum import Enum
from typing import Dict, NamedTuple, Sequence


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


def information_of(ending: Ending) -> Dict[str, str]:
    """What the feedback to a dispatcher holds beside success or failure: ``ActionFeedback.information``."""
    if ending.succeeded:
        return {}
    said = {
        "reason": ending.reason,
        "final": ending.no_retry,
        "stopped": "no" if ending.unstopped else "",
        "robot": ending.robot,
    }
    return {key: value for key, value in said.items() if value}


#: Outcome of a machine, one of whose states gave up: another try cannot help.
GIVEN_UP = "given_up"
#: The same, and nothing was done before.
NOT_BEGUN = "not_begun"


def no_retry(operator: str, arguments: Sequence[str], about: str) -> str:
    """The actions that can no longer help after one was given up.

    :param arguments: of that action.
    :param about: the argument on account of which it was; empty or another word: all of them.
    """
    found = about.lower() in map(str.lower, arguments)
    kept = [argument if not found or argument.lower() == about.lower() else "*" for argument in arguments]
    return f"({' '.join([operator, *kept])})"


class Closing(Enum):
    """How the knowledge of an execution is closed."""

    END = "end"
    """The effects came true."""
    INTERRUPT = "interrupt"
    """Stopped while it ran: the facts that the action declares for this case hold, else the earlier ones."""
    ROLLBACK = "rollback"
    """Never began: the earlier facts hold."""


def closing_of(ending: Ending) -> Closing:
    """How the knowledge of an execution is closed."""
    if ending.succeeded:
        return Closing.END
    return Closing.INTERRUPT if ending.begun else Closing.ROLLBACK


def after_closing(ending: Ending, faults: Sequence[str]) -> Ending:
    """What is answered once the knowledge was closed.

    :param faults: why that did not work, empty when it did. Effects that are not in the knowledge did not
        come true for the rest of the plan.
    """
    if not faults:
        return ending
    why = f"{ending.reason or 'it ran'}, and the knowledge could not be updated: {'; '.join(faults)}"
    return ending._replace(succeeded=False, reason=why)

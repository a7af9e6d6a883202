"""How an execution ends, what that does to the knowledge, and what its dispatcher hears of it."""

from enum import Enum
from typing import NamedTuple, Sequence


class Ending(NamedTuple):
    """How an execution ended: whether the action's effects came true, and if not, why."""

    succeeded: bool
    reason: str = ""
    begun: bool = True
    """False when nothing was done at all: the world is as it was before the dispatch."""
    unstopped: str = ""
    """What did not stop when it was told to, by name; empty when everything of it has ended."""


class Closing(Enum):
    """What becomes of an execution's knowledge."""

    END = "end"
    """The effects came true."""
    INTERRUPT = "interrupt"
    """It was stopped on its way: what the action declares for that case holds, else what was before."""
    ROLLBACK = "rollback"
    """It never began: all is as before."""


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

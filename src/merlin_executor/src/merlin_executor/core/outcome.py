# SPDX-License-Identifier: Apache-2.0
"""How a request can end, and what made it stop. Pure: the numbers are those of merlin_msgs/Execute."""

from enum import Enum, IntEnum
from typing import NamedTuple, Sequence

from merlin_ros.work.threads import failure_text

LONGEST_REASON = 2000  # characters of the last reason


class Outcome(IntEnum):
    """The outcomes of merlin_msgs/Execute."""

    SUCCEEDED = 0
    ALREADY_TRUE = 1
    CANCELLED = 2
    DROPPED = 3
    REFUSED = 4
    UNSOLVABLE = 5
    PLANNER_TIMEOUT = 6
    PLANNER_ERROR = 7
    ACTION_FAILED = 8
    CANCEL_TIMEOUT = 9
    INTERNAL = 10
    NO_PLAN = 11
    LATE = 12

    @property
    def achieved(self) -> bool:
        """Whether the goal holds."""
        return self in (Outcome.SUCCEEDED, Outcome.ALREADY_TRUE)

    @property
    def of_software(self) -> bool:
        """Whether a node needs attention, rather than the world or the goal."""
        return self in (Outcome.PLANNER_ERROR, Outcome.CANCEL_TIMEOUT, Outcome.INTERNAL)

    def verb(self, accepted: bool) -> str:
        """How a goal of an action server ends with it: ``succeed``, ``cancelled``, ``reject`` or ``abort``.

        :param accepted: whether the client got the state ACTIVE; such a request cannot be rejected.
        """
        if self.achieved:
            return "succeed"
        if self in (Outcome.CANCELLED, Outcome.DROPPED):
            return "cancelled"
        return "reject" if self in (Outcome.REFUSED, Outcome.LATE) and not accepted else "abort"


class Verdict(NamedTuple):
    """The end of a run or of a request."""

    outcome: Outcome
    reason: str = ""
    """Why, as one sentence; what clients read."""
    action: str = ""
    """The action that failed or did not stop, as PDDL text."""
    trouble: str = ""
    """Which part did not answer while it was stopped, as a sentence."""


class StopKind(Enum):
    """What makes a running request stop."""

    CANCELLED = "cancelled by its client"
    CLIENT_LOST = "its client is gone"
    INTERRUPTED = "interrupted by a more urgent request"
    ANOTHER = "planned again without other requests"
    JOINED = "planned again with the requests that came meanwhile"
    LATE = "its deadline has passed"
    SHUTDOWN = "the executor shuts down"


class Stop(NamedTuple):
    """Why a running request has to stop."""

    kind: StopKind
    text: str = ""
    """More exactly; empty: the kind says all."""

    @property
    def reason(self) -> str:
        """The reason as a sentence."""
        return self.text or self.kind.value

    @property
    def is_final(self) -> bool:
        """Whether the request has to end; another one may run again."""
        return self.kind not in (StopKind.INTERRUPTED, StopKind.ANOTHER, StopKind.JOINED)


def end_words(goals: Sequence[str], verdict: Verdict) -> str:
    """Which request has ended, and how, as a sentence."""
    return f"{', '.join(goals)}: {verdict.reason or 'done'}"[:LONGEST_REASON]


def outcome_name(outcome: int) -> str:
    """The name of an outcome: 2 → ``CANCELLED``."""
    try:
        return Outcome(outcome).name
    except ValueError:
        return str(outcome)


def crashed(error: BaseException) -> Verdict:
    """The verdict on a request whose run raised an unexpected exception."""
    return Verdict(Outcome.INTERNAL, f"the executor failed: {failure_text(error)[:500]}")

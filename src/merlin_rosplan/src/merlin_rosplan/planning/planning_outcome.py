# SPDX-License-Identifier: Apache-2.0
"""What became of one planning: enum and a sentence."""

from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Dict, Tuple

#: In place of a time.
NOT_KNOWN = -1.0


class PlannerState(IntEnum):
    """State of a planner; the numbers are those of merlin_msgs/PlannerStatus."""

    IDLE = 0
    RUNNING = 1
    SOLVED = 2
    UNSOLVABLE = 3  # proven: no plan exists
    TIMEOUT = 4
    CRASHED = 5  # could not start, ended abnormally, ran out of memory, or said nothing
    INVALID = 6  # the domain or the problem is not valid PDDL, or the plan did not validate
    CANCELLED = 7
    NO_PLAN = 8  # the planner gave up without a plan and without a proof that there is none


@dataclass(frozen=True)
class PlanningOutcome:
    """The end of one planning.

    :param state: how it ended.
    :param reason: one sentence; for SOLVED the size of the plan.
    :param plan: text in POPF's form, empty unless SOLVED (and when the empty plan solves the problem).
    :param planner: which program planned.
    :param seconds: of wall time.
    :param reached: s from the begin of the plan at which each goal with a deadline is reached; where it is
        proven that they cannot all be in time, by a plan without the deadlines, or NOT_KNOWN; empty: no plan.
    """

    state: PlannerState
    reason: str
    plan: str = ""
    planner: str = ""
    seconds: float = 0.0
    reached: Tuple[float, ...] = ()

    @property
    def status(self) -> Dict[str, Any]:
        """The fields of a merlin_msgs/PlannerStatus."""
        return {name: getattr(self, name) for name in ("state", "reason", "planner", "seconds")}

    @property
    def solved(self) -> bool:
        """Whether there is a plan."""
        return self.state == PlannerState.SOLVED

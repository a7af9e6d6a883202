# SPDX-License-Identifier: Apache-2.0
"""How a goal of actionlib ends."""

from enum import IntEnum


class GoalEnd(IntEnum):
    """The end of a goal, by its number in actionlib_msgs/GoalStatus.

    Any other number, which a foreign server may send with its result, means ABORTED.
    """

    PREEMPTED = 2
    """Cancelled while it ran."""
    SUCCEEDED = 3
    ABORTED = 4
    REJECTED = 5
    RECALLED = 8
    """Cancelled before it ran."""
    LOST = 9
    """Its server is gone."""

    @property
    def begun(self) -> bool:
        """Whether its server may have done something."""
        return self not in (GoalEnd.RECALLED, GoalEnd.REJECTED)

    @classmethod
    def _missing_(cls, value: object) -> "GoalEnd":
        return cls.ABORTED

# SPDX-License-Identifier: Apache-2.0
"""What a simulated server does with its goals, drawn from a seed."""

import random
from enum import Enum
from typing import NamedTuple, Union


class Act(Enum):
    """What happens to a goal."""

    SUCCEED = "succeed"
    FAIL = "fail"
    HANG = "hang"
    """Neither ends nor reacts to a cancel."""
    CRASH = "crash"
    """The process ends without a word."""


class Draw(NamedTuple):
    """What a simulated server does with one goal."""

    act: Act
    duration: float
    """s until it succeeds, fails or crashes."""


class Behaviour:
    """A seeded stream of fates: the n-th goal of a seed always has the same one.

    :param duration: mean, s.
    :param spread: standard deviation, s.
    :param fail: share of goals that fail, 0..1; likewise `hang` and `crash`.
    :param seed: of the stream.
    :raises ValueError: for a share outside 0..1, shares above 1 together, or a negative duration.
    """

    def __init__(
        self,
        duration: float = 0.1,
        spread: float = 0.0,
        fail: float = 0.0,
        hang: float = 0.0,
        crash: float = 0.0,
        seed: Union[int, str] = 0,
    ) -> None:
        shares = {Act.FAIL: fail, Act.HANG: hang, Act.CRASH: crash}
        if any(not 0.0 <= share <= 1.0 for share in shares.values()) or sum(shares.values()) > 1.0:
            raise ValueError(
                f"fail, hang and crash have to be 0..1, together at most 1; got {fail}, {hang}, {crash}"
            )
        if duration < 0.0 or spread < 0.0:
            raise ValueError(f"duration and spread cannot be negative; got {duration}, {spread}")
        self._duration = duration
        self._spread = spread
        self._shares = shares
        self._seed = seed

    def draw(self, number: int) -> Draw:
        """The fate of the goal of that number, counted from 0."""
        stream = random.Random(f"{self._seed}/{number}")
        duration = max(0.0, stream.gauss(self._duration, self._spread))
        dice = stream.random()
        for act, share in self._shares.items():
            if dice < share:
                return Draw(act, duration)
            dice -= share
        return Draw(Act.SUCCEED, duration)

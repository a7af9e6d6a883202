# SPDX-License-Identifier: Apache-2.0
"""Which robot takes an open goal: that of the cheapest bid; the next one when it does not claim."""

import bisect
import functools
import zlib
from typing import Dict, List, NamedTuple, Optional, Tuple

from merlin_fleet.core.records import Bid, Bids, Goal, Profile


class AuctionTimes(NamedTuple):
    """Times of an auction, s."""

    window: float = 1.5
    """For which the bids of robots that have not answered are awaited."""
    step: float = 2.0
    """For which the second best waits for the best, the third for the second, and so on."""
    crowd: int = 8
    """Most robots that bid at once; with more, the bids are spread over `spread`."""
    spread: float = 0.9
    enough: int = 4
    """With many robots, a robot does not bid when there are so many cheaper bids."""


def unsuited(goal: Goal, robot: Profile) -> str:
    """Why a robot cannot take a goal, whatever it costs; empty: it can."""
    if goal.robot and goal.robot != robot.name:
        return f"it is for the robot {goal.robot}"
    if goal.domain and robot.domain and goal.domain not in (robot.domain, robot.domain.partition("@")[0]):
        return f"it is of the domain {goal.domain}, the robot has {robot.domain}"
    if goal.groups and not set(goal.groups) & set(robot.groups):
        return f"it is for robots of {' or '.join(goal.groups)}"
    missing = sorted(set(goal.needs) - set(robot.capabilities))
    return f"it needs {', '.join(missing)}" if missing else ""


def order(goal: Goal) -> Tuple[float, float, float, str]:
    """Sorts goals: the greatest value, the earliest deadline, the oldest first."""
    return (-goal.value, goal.deadline if goal.deadline is not None else float("inf"), goal.sent, goal.id)


class Offers:
    """The bids of all joined robots, for each goal the cheapest first."""

    def __init__(self) -> None:
        self._of: Dict[str, Bids] = {}
        self._ranked: Dict[str, List[Tuple[float, int, str]]] = {}
        self._answers: Dict[str, int] = {}
        self.closed = 0
        """Number of robots that bid for no goal at present."""

    def of(self, robot: str) -> Optional[Bids]:
        """The bids of a robot."""
        return self._of.get(robot)

    def put(self, robot: str, bids: Bids) -> None:
        """A robot has written its bids."""
        before = self._of.get(robot, Bids())
        old, new = before.of.items(), bids.of.items()
        for goal, bid in old - new:
            self._withdraw(goal, robot, bid)
        for goal, bid in new - old:
            self._answers[goal] = self._answers.get(goal, 0) + 1
            if bid.cost is not None:
                bisect.insort(self._ranked.setdefault(goal, []), _offer(goal, robot, bid.cost))
        self.closed += bool(bids.reason) - bool(before.reason)
        self._of[robot] = bids

    def remove(self, robot: str) -> None:
        """A robot is no longer joined."""
        self.put(robot, Bids())
        del self._of[robot]

    def cheaper(self, goal: str, robot: str, cost: float) -> int:
        """How many bids for a goal are cheaper than that of a robot with this cost."""
        return bisect.bisect_left(self._ranked.get(goal, ()), _offer(goal, robot, cost))

    def offered(self, goal: str) -> bool:
        """Whether a robot offers to do a goal."""
        return goal in self._ranked

    def answers(self, goal: str) -> int:
        """How many robots have answered: with a bid, with a refusal, or that they bid for no goal."""
        return self._answers.get(goal, 0) + self.closed

    def _withdraw(self, goal: str, robot: str, bid: Bid) -> None:
        self._answers[goal] -= 1
        if not self._answers[goal]:
            del self._answers[goal]
        if bid.cost is not None:
            ranked = self._ranked[goal]
            del ranked[bisect.bisect_left(ranked, _offer(goal, robot, bid.cost))]
            if not ranked:
                del self._ranked[goal]


def take_at(
    goal: str, robot: str, offers: Offers, joined: int, opened: float, times: AuctionTimes
) -> Optional[float]:
    """When a robot takes a goal, unless another one does; None: it has not bid.

    :param joined: number of robots that are joined.
    :param opened: when this robot saw that the goal is open.
    """
    bid = (offers.of(robot) or Bids()).of.get(goal)
    if bid is None or bid.cost is None:
        return None
    window = times.window if offers.answers(goal) < joined else 0.0
    return opened + window + offers.cheaper(goal, robot, bid.cost) * times.step


def lot(goal: str, robot: str) -> int:
    """A number that differs for each pair, and is the same on every robot."""
    return zlib.crc32(f"{goal} {robot}".encode())


_lot_of_a_bid = functools.lru_cache(maxsize=4096)(lot)


def _offer(goal: str, robot: str, cost: float) -> Tuple[float, int, str]:
    """Sorts bids; the lot decides between equal costs, differently for each goal."""
    return cost, _lot_of_a_bid(goal, robot), robot

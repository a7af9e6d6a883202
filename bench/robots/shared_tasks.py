# SPDX-License-Identifier: Apache-2.0
"""The least time in which several robots can do tasks that they may share as they like: a lower bound.

Each robot does its tasks one after the other, along shortest paths and at the limits of the oracle; robots
never hinder each other. From its second task on a robot begins in the direction of its way: no turn counts.
"""

import itertools
from typing import Dict, Mapping, NamedTuple, Sequence, Tuple

from merlin_experiment.oracle.oracle import Oracle
from merlin_experiment.oracle.outlines import Point
from merlin_experiment.oracle.shortest_path import ShortestPaths


class Stand(NamedTuple):
    """Where a robot is at rest: frame map, m and rad."""

    x: float
    y: float
    yaw: float


class SharedTasks:
    """Lower bounds in one place.

    :param oracle: of the robots, which are alike.
    :param paths: the same as the oracle's.
    """

    def __init__(self, oracle: Oracle, paths: ShortestPaths) -> None:
        self._oracle = oracle
        self._paths = paths
        self._between: Dict[Tuple[Point, Point], float] = {}

    def time(self, robots: Sequence[Stand], points: Sequence[Point]) -> float:
        """The least time until all tasks are done, s.

        Every division among the robots is tried, and every order: for a few tasks.

        :param robots: where they are; one or more.
        :param points: where the tasks are, frame map, m.
        :raises NoPathError: when no path exists.
        """
        first = {
            (robot, point): self._oracle.task((robot.x, robot.y), robot.yaw, point).time
            for robot in robots
            for point in points
        }
        divisions = itertools.product(range(len(robots)), repeat=len(points))
        return min(self._longest(robots, points, division, first) for division in divisions)

    def _longest(
        self,
        robots: Sequence[Stand],
        points: Sequence[Point],
        division: Sequence[int],
        first: Mapping[Tuple[Stand, Point], float],
    ) -> float:
        times = [0.0]
        for number, robot in enumerate(robots):
            own = [point for point, owner in zip(points, division) if owner == number]
            orders = itertools.permutations(own)
            times.append(
                min(
                    sum(self._leg(*leg) for leg in zip(order, order[1:]))
                    + (first[robot, order[0]] if order else 0.0)
                    for order in orders
                )
            )
        return max(times)

    def _leg(self, start: Point, goal: Point) -> float:
        if (start, goal) not in self._between:
            heading = self._paths.path(start, goal).direction if start != goal else 0.0
            self._between[start, goal] = self._oracle.task(start, heading, goal).time
        return self._between[start, goal]

# SPDX-License-Identifier: Apache-2.0
"""An empty floor with points of interest, for errands of the domain of the home. Without ROS."""

import itertools
import math
import random
from pathlib import Path
from typing import List, Sequence, Tuple

import numpy as np

SIDE = 20.0  # m
SPEED, TURNING = 0.3, 3.0  # m/s and s, as in the problem of the home
QUESTION = 5.0  # s, the duration of (ask POINT) in the domain
UNKNOWN = 10.0  # m to each point from "anywhere"


class Floor:
    """Points at random places; a drive goes straight.

    :param size: number of points.
    :param seed: of the places.
    """

    def __init__(self, size: int, seed: int = 1) -> None:
        chance = random.Random(seed)
        self._places = {
            f"p{each}": (chance.uniform(0, SIDE), chance.uniform(0, SIDE)) for each in range(size)
        }

    @property
    def points(self) -> List[str]:
        """Their names."""
        return list(self._places)

    def place(self, point: str) -> Tuple[float, float]:
        """Where a point is, m."""
        return self._places[point]

    def metres(self, start: str, end: str) -> float:
        """Length of a drive."""
        if start not in self._places:
            return UNKNOWN
        return math.dist(self._places[start], self._places[end])

    def write(self, folder: Path) -> None:
        """Writes ``problem.pddl`` and ``points.yaml``."""
        drives = [(a, b) for a in (*self.points, "anywhere") for b in self.points if a != b]
        times = [f"(= (travel_time {a} {b}) {self.metres(a, b) / SPEED + TURNING:.2f})" for a, b in drives]
        (folder / "problem.pddl").write_text(
            f"(define (problem floor) (:domain home) (:objects {' '.join(self.points)} - poi)\n"
            f"(:init (in_service) (robot_at anywhere)\n{chr(10).join(times)})\n"
            "(:goal (in_service)) (:metric minimize (total-time)))\n"
        )
        places = [f"  {name}: {{x: {x:.2f}, y: {y:.2f}, yaw: 0.0}}" for name, (x, y) in self._places.items()]
        (folder / "points.yaml").write_text("\n".join(["points_of_interest:", *places]) + "\n")

    def tour(self, stops: Sequence[str]) -> float:
        """Metres of a tour in this order."""
        return sum(self.metres(start, end) for start, end in zip(stops, stops[1:]))

    def shortest(self, start: str, stops: Sequence[str]) -> float:
        """Metres of the shortest tour that begins at a point and ends anywhere (Held and Karp)."""
        count = len(stops)
        between = np.array([[self.metres(a, b) for b in stops] for a in stops], np.float32)
        least = np.full((1 << count, count), np.inf, np.float32)  # per set of visited stops and the last one
        for number, stop in enumerate(stops):
            least[1 << number, number] = self.metres(start, stop)
        sets = np.arange(1, 1 << count)
        sizes = sum((sets >> number) & 1 for number in range(count))
        for size in range(1, count):
            visited = sets[sizes == size]
            for number in range(count):
                without = visited[(visited >> number) & 1 == 0]
                longer = least[without] + between[:, number]
                least[without | (1 << number), number] = longer.min(axis=1)
        return float(least[-1].min())

    def short(self, start: str, stops: Sequence[str]) -> float:
        """Metres of a short tour likewise: the nearest stop next, then parts are turned round."""
        tour, left = [start], set(stops)
        while left:
            tour.append(min(left, key=lambda stop: self.metres(tour[-1], stop)))
            left.remove(tour[-1])
        better = True
        while better:
            better = False
            for first, last in itertools.combinations(range(1, len(tour)), 2):
                turned = [*tour[:first], *reversed(tour[first : last + 1]), *tour[last + 1 :]]
                ends = slice(first - 1, first + 1), slice(last, last + 2)
                if sum(self.tour(turned[end]) - self.tour(tour[end]) for end in ends) < -1e-9:
                    tour, better = turned, True
        return self.tour(tour)


def seconds(metres: float, errands: int) -> float:
    """How long a tour takes by the domain, s."""
    return metres / SPEED + errands * (TURNING + QUESTION)

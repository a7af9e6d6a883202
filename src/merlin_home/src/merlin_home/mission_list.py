# SPDX-License-Identifier: Apache-2.0
"""The task lists of the paper's missions.

A mission is a list of points of interest whose neighbours differ; half of its tasks are marked, which
means that they will be cancelled while they run.

The algorithm, so that a list can be made again anywhere: two streams of numbers in [0, 1) come from
Mersenne twisters seeded with the texts `list <tasks> <seed>` and `marks <tasks> <seed>` (Python's
`random.Random(text).random()`). *Points*: they are sorted by name; number u picks the point at
floor(u * n) of those that may follow, all for the first task and all but the last one visited afterwards.
*Marks*: the task numbers 0 … n-1 are shuffled (from the last place down to the second, place i swaps
with place floor(u * (i + 1))), and the first round(share * n) of the result are marked. So the marks of a
smaller share are among those of a larger one.
"""

import random
from dataclasses import dataclass
from typing import List, Sequence

#: Tasks of the paper's Missions 1, 2 and 3.
MISSION_TASKS = {1: 6, 2: 20, 3: 120}


class MissionListError(ValueError):
    """The list cannot be made; the text says why and what to do."""


@dataclass(frozen=True)
class MissionTask:
    """One entry of a mission.

    :param number: from 1.
    :param poi: point of interest to check.
    :param marked: True when the task is cancelled if it still runs some time after it was sent.
    """

    number: int
    poi: str
    marked: bool


def mission_tasks(mission: int) -> int:
    """Number of tasks of one of the paper's missions.

    :raises MissionListError: when the mission does not exist.
    """
    if mission not in MISSION_TASKS:
        raise MissionListError(f"there is no mission {mission}; give one of {sorted(MISSION_TASKS)}")
    return MISSION_TASKS[mission]


def make_mission(
    points: Sequence[str], tasks: int, seed: int, marked_share: float = 0.5
) -> List[MissionTask]:
    """Makes a mission.

    :param points: names of the points of interest, in any order.
    :param tasks: length of the list.
    :param seed: the same seed gives the same list.
    :param marked_share: share of marked tasks, 0 to 1; it has to give a whole number of tasks.
    :raises MissionListError: for fewer than two points, no tasks, or a share that gives no whole number.
    """
    names = sorted(set(points))
    if len(names) < 2:
        raise MissionListError(f"a mission needs two points of interest or more, not {names}")
    if tasks < 1:
        raise MissionListError(f"a mission needs one task or more, not {tasks}")
    if not 0.0 <= marked_share <= 1.0:
        raise MissionListError(f"the share of marked tasks is {marked_share}; give a number from 0 to 1")
    marked = round(marked_share * tasks)
    if abs(marked - marked_share * tasks) > 1e-6:
        raise MissionListError(
            f"{marked_share} of {tasks} tasks is not a whole number; the paper's lists have an even length"
        )
    choose = random.Random(f"list {tasks} {seed}").random
    visits: List[str] = []
    for _ in range(tasks):
        candidates = [name for name in names if not visits or name != visits[-1]]
        visits.append(candidates[int(choose() * len(candidates))])
    chosen = set(_shuffled(tasks, f"marks {tasks} {seed}")[:marked])
    return [MissionTask(index + 1, poi, index in chosen) for index, poi in enumerate(visits)]


def _shuffled(count: int, seed: str) -> List[int]:
    """The numbers 0 … count-1 in a random order."""
    draw = random.Random(seed).random
    order = list(range(count))
    for place in range(count - 1, 0, -1):
        other = int(draw() * (place + 1))
        order[place], order[other] = order[other], order[place]
    return order

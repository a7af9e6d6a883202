# SPDX-License-Identifier: Apache-2.0
"""The matrix of meetings: how often several robots all get where they go, and in what time.

See docs/several-robots-measurements.md.
"""

import argparse
import statistics
import sys
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple

from matrices.meeting_trial import MeetingResult, Route, meet
from matrices.trial import trials
from merlin_reactive.navigation.navigator import DriveOutcome
from merlin_reactive.navigation.path_planner import PathPlanner
from merlin_reactive.pose import Point, Pose
from merlin_reactive.seeded_random import draw
from merlin_sim.world.survey import map_of
from merlin_sim.world.world_file import parse_world
from merlin_sim.world.world_model import World

SPEED = 0.3  # m/s
NAMES = ("ann", "bob", "carl", "dora")
Box = Tuple[float, float, float, float]
Case = Tuple[World, List[Tuple[Point, Point, float]]]  # starts, goals, s to stand first


def _room(
    size: Point, here: Point, walls: Sequence[Tuple[Point, Point]] = (), boxes: Sequence[Box] = ()
) -> World:
    """A hall with inner walls and boxes; `here` can be driven to."""
    width, depth = size
    corners = [(0.0, 0.0), (width, 0.0), (width, depth), (0.0, depth)]
    lines = [*zip(corners, [*corners[1:], corners[0]]), *walls]
    description: Dict[str, Any] = {
        "name": "meeting",
        "walls": [{"from": list(start), "to": list(end)} for start, end in lines],
        "furniture": [
            {"name": f"box_{number}", "at": [x, y], "box": [*sides, 1.0], "color": "#a67c52"}
            for number, (x, y, *sides) in enumerate(boxes)
        ],
        "points_of_interest": {"here": {"x": here[0], "y": here[1], "yaw": 0.0}},
        "starts": [],
    }
    return parse_world(description)


def _door() -> Case:
    """Two rooms of 3.5 x 4 m and a door of 0.9 m; all change rooms."""
    world = _room((7, 4), (1.0, 1.0), [((3.5, 0), (3.5, 1.5)), ((3.5, 2.4), (3.5, 4))])
    left, right = [(1.0, 2.0), (1.0, 3.2)], [(6.0, 2.0), (6.0, 0.8)]
    ways = [(left[0], right[0]), (right[0], left[0]), (left[1], right[1]), (right[1], left[1])]
    return world, [(start, goal, 0.0) for start, goal in ways]


def _corridor() -> Case:
    """Two rooms of 2.5 x 3 m and a corridor of 5 x 1 m between them; all change rooms."""
    world = _room((10, 3), (0.8, 0.8), (), [(5.0, 0.5, 5.0, 1.0), (5.0, 2.5, 5.0, 1.0)])
    left, right = [(0.9, 1.5), (1.2, 2.4)], [(9.1, 1.5), (8.8, 0.6)]
    ways = [(left[0], right[0]), (right[0], left[0]), (left[1], right[1]), (right[1], left[1])]
    return world, [(start, goal, 0.0) for start, goal in ways]


def _crossing() -> Case:
    """Two corridors of 1.2 m that cross; each robot goes straight on."""
    boxes = [(x, y, 2.4, 2.4) for x in (1.2, 4.8) for y in (1.2, 4.8)]
    world = _room((6, 6), (3.0, 3.0), (), boxes)
    ends = [
        ((0.5, 3.0), (5.5, 3.0)),
        ((3.0, 0.5), (3.0, 5.5)),
        ((5.5, 3.0), (0.5, 3.0)),
        ((3.0, 5.5), (3.0, 0.5)),
    ]
    return world, [(start, goal, 0.0) for start, goal in ends]


def _occupied() -> Case:
    """Pairs change places in a room of 5 x 4 m; each robot sets off later than the one before."""
    world = _room((5, 4), (0.8, 0.8), (), [(2.5, 2.0, 1.0, 1.0)])
    places = [(0.8, 0.8), (4.2, 3.2), (0.8, 3.2), (4.2, 0.8)]
    return world, [(places[n], places[n ^ 1], 8.0 * n) for n in range(4)]


CASES: Dict[str, Callable[[], Case]] = {
    "door": _door,
    "corridor": _corridor,
    "crossing": _crossing,
    "goal occupied by the other": _occupied,
}


def trial(name: str, robots: int, seed: int) -> Tuple[MeetingResult, float]:
    """The result, and the sum of the robots' shortest ways, m."""
    world, ways = CASES[name]()
    routes = []
    # Starts a little elsewhere, and names in another order: which one goes first must not matter.
    order = draw(seed, "order", 0).permutation(robots)
    for number, (start, goal, after) in enumerate(ways[:robots]):
        dx, dy, yaw, later = draw(seed, "start", number).uniform(-1, 1, 4)
        pose = Pose(start[0] + 0.08 * dx, start[1] + 0.08 * dy, 3.14 * yaw)
        routes.append(Route(NAMES[order[number]], pose, Pose(*goal), after + 1.0 + later))
    planner = PathPlanner(map_of(world), 0.25, 0.05)
    paths = [planner.plan(route.start.point, route.goal.point) for route in routes]
    length = sum(Pose(*a).distance(Pose(*b)) for path in paths for a, b in zip(path, path[1:]))
    return meet(world, routes, seed), length


def main(arguments: Optional[List[str]] = None) -> int:
    """Prints the table; returns 1 when a trial was not solved."""
    parser = argparse.ArgumentParser(prog="bench/matrices meeting", description=__doc__)
    parser.add_argument("--seeds", type=trials, default=5, help="trials per case (default 5)")
    parser.add_argument(
        "--robots", type=int, choices=(2, 3, 4), help="only with so many (default 2, 3 and 4)"
    )
    parser.add_argument("--case", help="only the cases whose name contains this")
    options = parser.parse_args(arguments)
    chosen = [name for name in CASES if (options.case or "") in name]
    if not chosen:
        parser.error(f"no case contains {options.case!r}: {', '.join(CASES)}")
    wrong = []
    print(
        "| case | robots | solved | collisions | time, s (median) | sum of ways, s "
        "| time / sum | waited, s (mean) |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for robots in [options.robots] if options.robots else [2, 3, 4]:
        for name in chosen:
            found = [(seed, *trial(name, robots, seed)) for seed in range(1, options.seeds + 1)]
            results = [result for _, result, _ in found]
            time = statistics.median(result.time for result in results)
            ways = statistics.median(length for _, _, length in found) / SPEED
            print(
                f"| {name} | {robots} | {sum(result.solved for result in results)}/{len(results)} "
                f"| {sum(result.collisions for result in results)} | {time:.1f} | {ways:.1f} "
                f"| {time / ways:.2f} | {statistics.mean(result.waited for result in results):.1f} |",
                flush=True,
            )
            for seed, result, _ in found:
                ends = [
                    f"{robot} {outcome.value}: {result.texts[robot]}"
                    for robot, outcome in sorted(result.outcomes.items())
                    if outcome is not DriveOutcome.REACHED
                ]
                if not result.solved:
                    wrong.append(
                        f"{name}, {robots}, seed {seed}: {result.collisions} collisions; {'; '.join(ends)}"
                    )
    for line in wrong:
        print(line, file=sys.stderr)
    return 1 if wrong else 0

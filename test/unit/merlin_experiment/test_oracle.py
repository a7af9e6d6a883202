# SPDX-License-Identifier: Apache-2.0
"""The oracle against cases computed by hand, and against other means of finding a way."""

import heapq
import math
from typing import List, Sequence, Tuple

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from matrices.trial import Trial

from merlin_experiment.oracle.motion_limits import MotionLimits, SpeedProfile
from merlin_experiment.oracle.oracle import Oracle
from merlin_experiment.oracle.outlines import Outline, Outlines, outlines_of_map, outlines_of_world
from merlin_experiment.oracle.shortest_path import NoPathError, ShortestPaths, angle_between
from merlin_reactive.pose import Pose
from merlin_sim.world.world_file import find_world, load_world
from merlin_sim.world.world_model import MoveEvent

LIMITS = MotionLimits(speed=0.5, acceleration=1.0, turn_rate=1.0, turn_acceleration=2.0, radius=0.25)
Box = Tuple[float, float, float, float]  # left, low, right, high, m
BOXES = st.builds(
    lambda x, y, width, height: (x, y, x + width, y + height),
    st.floats(0.5, 3.5),
    st.floats(-1.5, 1.5),
    st.floats(0.05, 0.8),
    st.floats(0.05, 0.8),
)


def outlines(boxes: Sequence[Box] = ()) -> Outlines:
    return Outlines(
        Outline(((left, low), (right, low), (right, high), (left, high))) for left, low, right, high in boxes
    )


def paths(*boxes: Box) -> ShortestPaths:
    return ShortestPaths(outlines(boxes), 0.25)


def test_a_long_way_is_a_trapezoid() -> None:
    # 0.5 s up to 0.5 m/s (0.125 m), 0.5 s down (0.125 m), 1.75 m at 0.5 m/s = 3.5 s
    profile = SpeedProfile(2.0, 0.5, 1.0)
    assert profile.duration == pytest.approx(4.5)
    assert profile.way_at(0.5) == pytest.approx(0.125)
    assert profile.way_at(2.5) == pytest.approx(1.125)
    assert profile.way_at(4.25) == pytest.approx(2.0 - 0.5 * 0.25**2)


def test_a_short_way_is_a_triangle() -> None:
    # 0.16 m at 1 m/s²: peak 0.4 m/s, 0.4 s up and 0.4 s down
    profile = SpeedProfile(0.16, 0.5, 1.0)
    assert profile.peak == pytest.approx(0.4)
    assert profile.duration == pytest.approx(0.8)
    assert profile.way_at(0.4) == pytest.approx(0.08)


@given(st.floats(0, 100), st.floats(0.01, 10), st.floats(0.01, 10), st.floats(0, 1), st.floats(0, 1))
def test_a_profile_covers_its_way_once_and_never_backwards(
    way: float, speed: float, acceleration: float, a: float, b: float
) -> None:
    profile = SpeedProfile(way, speed, acceleration)
    early, late = sorted([a * profile.duration, b * profile.duration])
    assert profile.way_at(early) <= profile.way_at(late) + 1e-9
    assert profile.way_at(profile.duration) == pytest.approx(way)
    assert profile.peak <= speed


def test_ahead_a_task_is_drive_and_speech() -> None:
    # 2 m at 0.5 m/s and 1 m/s² is 4.5 s; 5 s speech
    oracle = Oracle(paths(), LIMITS, speech=5.0)
    result = oracle.task((0.0, 0.0), 0.0, (2.0, 0.0))
    assert result.time == pytest.approx(9.5)
    assert result.distance == pytest.approx(2.0)


def test_setting_off_gains_while_it_turns() -> None:
    # Half a turn takes pi + 0.5 s and faces the path within a right angle after pi/2 + 0.25 s. From then on
    # full speed at once and a constant turn rate would gain 0.5 m/s * 1 s, the cosine's integral. Speeding
    # up takes 0.0206 m of that, the integral of (0.5 - t) sin(t) over 0.5 s; the slow end of the turn, 0.25 s
    # more at almost no angle, adds 0.125 m.
    drive = LIMITS.set_off(math.pi, 3.0)
    turn = math.pi + 0.5
    assert drive.way_at(math.pi / 2 + 0.25) == pytest.approx(0.0, abs=0.002)
    gained = drive.way_at(turn)
    assert gained == pytest.approx(0.5 - 0.0206 + 0.125, abs=0.01)
    # at full speed then: the rest less the braking way of 0.125 m, and 0.5 s of braking
    assert drive.duration == pytest.approx(turn + (3.0 - gained - 0.125) / 0.5 + 0.5, abs=0.01)
    assert drive.way_at(drive.duration) == pytest.approx(3.0)


@given(st.floats(0, math.pi), st.floats(0, 20), st.floats(0, 1), st.floats(0, 1))
def test_setting_off_is_never_slower_than_turning_first_nor_faster_than_no_turn(
    angle: float, distance: float, a: float, b: float
) -> None:
    drive = LIMITS.set_off(angle, distance)
    straight = LIMITS.drive(distance).duration
    assert drive.duration <= straight + LIMITS.turn(angle).duration + 0.01
    assert drive.duration >= straight - 0.01
    early, late = sorted([a * drive.duration, b * drive.duration])
    assert drive.way_at(early) <= drive.way_at(late) + 1e-9
    assert drive.way_at(drive.duration) == pytest.approx(distance, abs=0.002)


def test_the_shorter_turn_counts() -> None:
    oracle = Oracle(paths(), LIMITS, speech=0.0)
    left = oracle.task((0.0, 0.0), math.radians(170), (-0.5, 0.0))
    right = oracle.task((0.0, 0.0), math.radians(-170), (-0.5, 0.0))
    assert left.time == pytest.approx(right.time)
    assert left.time < 2.0


def test_a_cancelled_task_ends_when_it_is_cancelled() -> None:
    oracle = Oracle(paths(), LIMITS, speech=5.0)
    result = oracle.task((0.0, 0.0), 0.0, (2.0, 0.0), cancel_after=2.5)
    assert result.time == 2.5
    assert result.distance == pytest.approx(1.125)
    late = oracle.task((0.0, 0.0), 0.0, (2.0, 0.0), cancel_after=60.0)
    assert late.time == pytest.approx(9.5)


def test_a_task_at_the_robots_place_is_only_speech() -> None:
    oracle = Oracle(paths(), LIMITS, speech=5.0, goal_tolerance=0.1)
    assert oracle.task((0.0, 0.0), 1.0, (0.0, 0.0)).time == 5.0
    assert oracle.task((0.0, 0.0), 1.0, (0.05, 0.0)).distance == 0.0


def test_who_still_moves_as_it_is_sent_on_is_ahead() -> None:
    oracle = Oracle(paths(), LIMITS, speech=0.0)
    rest = oracle.task((0.0, 0.0), 0.0, (2.0, 0.0))
    # Full speed at once saves the half of the time that speeding up takes.
    moving = oracle.task((0.0, 0.0), 0.0, (2.0, 0.0), motion=(0.5, 0.0))
    assert moving.time == pytest.approx(rest.time - 0.25)
    aside = oracle.task((0.0, 0.0), 2.0, (2.0, 0.0))
    assert oracle.task((0.0, 0.0), 2.0, (2.0, 0.0), motion=(0.0, -0.5)).time < aside.time - 0.1
    assert oracle.task((0.0, 0.0), 2.0, (2.0, 0.0), motion=(0.0, 0.5)).time == pytest.approx(aside.time)


@pytest.mark.parametrize("heading", [0.0, 0.7, 1.5, 2.2, math.pi])
@pytest.mark.parametrize("begin", [0.0, 0.3, 0.8, 1.2, 1.57])
def test_no_way_of_driving_is_faster(heading: float, begin: float) -> None:
    """A robot that knows everything, without delay, and sets off at some angle from its goal."""
    best = Oracle(paths(), LIMITS, speech=0.0, goal_tolerance=0.1).task((0.0, 0.0), heading, (2.0, 0.0))
    x = y = speed = turn = time = 0.0
    yaw, step = heading, 0.001
    while math.hypot(2.0 - x, y) > 0.1 or speed > 0.0:
        left = math.hypot(2.0 - x, y)
        off = angle_between(yaw, math.atan2(-y, 2.0 - x))
        wanted = math.copysign(min(LIMITS.turn_rate, math.sqrt(2 * 2.0 * abs(off))), off)
        turn += max(-2.0 * step, min(2.0 * step, wanted - turn))
        brakes = left - speed**2 / 2.0 <= 0.1
        go = abs(off) <= begin + 1e-3 and not brakes
        speed = max(0.0, min(LIMITS.speed, speed + (step if go else -step)))
        yaw += turn * step
        x, y, time = x + speed * math.cos(yaw) * step, y + speed * math.sin(yaw) * step, time + step
        if time > 20.0:
            break  # one that stands for ever is not faster either
    assert time >= best.time - 0.005


def test_the_way_round_a_wall_touches_its_end() -> None:
    # a wall at x = 1.9 … 2.0 from the bottom up to y = 1.0
    route = paths((1.9, -9.0, 2.0, 1.0)).path((0.0, 0.0), (3.9, 0.0))
    # Two tangents to discs of 0.25 m round the wall's upper corners, (1.9, 1.0) and (2.0, 1.0), from 1.9 m
    # beside and 1 m below, and the arcs between.
    reach = math.hypot(1.9, 1.0)
    tangent = math.sqrt(reach**2 - 0.25**2)
    arc = math.atan2(1.0, 1.9) + math.asin(0.25 / reach)
    assert route.length == pytest.approx(2 * tangent + 2 * 0.25 * arc + 0.1, abs=1e-6)
    assert route.direction == pytest.approx(arc)
    drawn = sum(math.dist(a, b) for a, b in zip(route.points, route.points[1:]))
    assert drawn == pytest.approx(route.length, abs=1e-4)


def test_the_way_round_a_pillar_is_an_arc_of_both_radii() -> None:
    pillar = ShortestPaths(Outlines([Outline(((2.0, 0.0),), 0.15)]), 0.25)
    half = math.acos(0.4 / 2.0)
    expected = 2 * math.sqrt(4.0 - 0.16) + 0.4 * (math.pi - 2 * half)
    assert pillar.path((0.0, 0.0), (4.0, 0.0)).length == pytest.approx(expected, abs=1e-6)


def test_no_way() -> None:
    walls = [(-1.0, -1.0, 5.0, -0.9), (-1.0, 1.0, 5.0, 1.1), (-1.0, -1.0, -0.9, 1.0), (2.0, -1.0, 2.1, 1.0)]
    with pytest.raises(NoPathError, match="no way"):
        paths(*walls).path((0.0, 0.0), (3.9, 0.0))


@pytest.mark.parametrize("wider", [1e-4, 0.02])
def test_a_gap_lets_the_robot_through_when_it_is_as_wide_as_the_robot(wider: float) -> None:
    def gap(width: float) -> ShortestPaths:
        return paths((1.9, width / 2, 2.0, 5.0), (1.9, -5.0, 2.0, -width / 2))

    through = gap(0.5 + wider).path((0.0, 0.1), (3.9, -0.1)).length
    assert through == pytest.approx(3.9, abs=0.05)
    around = gap(0.5 - wider).path((0.0, 0.1), (3.9, -0.1)).length
    assert around > 10.0


def test_a_robot_inside_an_obstacle_moves_out_of_it() -> None:
    # 5 mm too close to the wall, which a map may be off
    route = paths((-1.0, -0.3, 5.0, -0.245)).path((0.0, 0.0), (2.0, 0.0))
    assert route.length == pytest.approx(2.0, abs=0.02)
    with pytest.raises(NoPathError, match="cannot stand"):
        paths((-3.0, -3.0, 3.0, 3.0)).path((0.0, 0.0), (9.0, 0.0))


@settings(max_examples=12, deadline=None)
@given(
    st.lists(BOXES, max_size=3),
    st.floats(-0.4, -0.2),
    st.floats(-1.5, 1.5),
    st.floats(-1.5, 1.5),
)
def test_paths_are_as_short_as_a_search_over_many_points_finds_them(
    boxes: List[Box], x: float, y: float, goal_y: float
) -> None:
    start, goal = (x, y), (4.9, goal_y)
    # Between some boxes there is room to a millimetre, which is below the search's resolution.
    thin, thick = (ShortestPaths(outlines(boxes), radius).path(start, goal) for radius in (0.245, 0.255))
    assume(thick.length - thin.length < 0.1)
    there = paths(*boxes).path(start, goal)
    assert there.length == pytest.approx(paths(*boxes).path(goal, start).length, abs=1e-6)
    assert there.length == pytest.approx(_searched(boxes, start, goal), abs=0.02)
    assert _room(boxes, np.array(there.points)).min() >= 0.25 - 2e-4


def _room(boxes: Sequence[Box], points: np.ndarray) -> np.ndarray:
    """Distances of points from the nearest of upright boxes."""
    room = np.full(len(points), math.inf)
    for left, low, right, high in boxes:
        beside = np.maximum(0.0, np.maximum(left - points[:, 0], points[:, 0] - right))
        above = np.maximum(0.0, np.maximum(low - points[:, 1], points[:, 1] - high))
        room = np.minimum(room, np.hypot(beside, above))
    return room


def _searched(boxes: Sequence[Box], start: tuple, goal: tuple) -> float:
    """Dijkstra's algorithm over points on the rims of the grown boxes, lines tested point by point."""
    nodes = [start, goal]
    for left, low, right, high in boxes:
        for x, y, first in ((right, high, 0), (left, high, 90), (left, low, 180), (right, low, 270)):
            turns = np.radians(first + np.linspace(0.0, 90.0, 10))
            nodes += list(zip(x + 0.2505 * np.cos(turns), y + 0.2505 * np.sin(turns)))
    places = np.array(nodes)
    places = places[_room(boxes, places) >= 0.25]
    steps = np.linspace(0.0, 1.0, 250)[:, None]
    best = {0: 0.0}
    queue, done = [(0.0, 0)], set()
    while queue:
        length, here = heapq.heappop(queue)
        if here == 1:
            return length
        if here in done:
            continue
        done.add(here)
        for other in range(len(places)):
            total = length + float(np.hypot(*(places[other] - places[here])))
            if other in done or total >= best.get(other, math.inf):
                continue
            # Chords of the rims come 1 mm nearer than the rims.
            if _room(boxes, places[here] + steps * (places[other] - places[here])).min() >= 0.2485:
                best[other] = total
                heapq.heappush(queue, (total, other))
    return math.inf


def test_a_map_is_never_harder_than_what_it_shows() -> None:
    world = load_world(find_world("apartment"))
    grid = np.zeros((60, 80), dtype=bool)
    grid[20:23, 10:40] = True  # centres from (0.525, 1.025) to (1.975, 1.125)
    shapes = outlines_of_map(grid, 0.05, (0.0, 0.0))
    assert len(shapes.shapes) == 1
    gaps = shapes.to_points(np.array([[1.0, 0.025], [0.025, 1.025], [1.0, 1.1]]))
    assert gaps[:, 0] == pytest.approx([1.0, 0.5, 0.0])
    assert len(outlines_of_world(world).shapes) > 20


def test_what_may_move_is_no_obstacle_of_the_oracle() -> None:
    world = load_world(find_world("apartment"))
    everything = len(outlines_of_world(world).shapes)
    world.events.append(MoveEvent(5.0, "sofa", Pose(1.0, 1.0)))
    assert len(outlines_of_world(world).shapes) == everything - 1


def test_no_drive_of_the_simulated_robot_beats_the_oracle() -> None:
    world = load_world(find_world("apartment"))
    limits = MotionLimits()
    oracle = Oracle(ShortestPaths(outlines_of_world(world), limits.radius), limits, 0.0, 0.1)
    trial = Trial(world, world.points_of_interest["kitchen"], 1)
    try:
        for name in ("bathroom", "main_door"):
            here, goal = trial.robot.body.pose(), world.points_of_interest[name]
            best = oracle.task(here.point, here.yaw, goal.point)
            drive = trial.drive(goal)
            assert drive.reached
            assert drive.time > best.time
            assert drive.distance > best.distance
            assert drive.time < 1.15 * best.time, "and it comes near"
    finally:
        trial.close()


@given(st.floats(-10, 10), st.floats(-10, 10))
def test_turns_are_the_smaller_ones(start: float, end: float) -> None:
    turn = angle_between(start, end)
    assert abs(turn) <= math.pi + 1e-9
    assert math.cos(start + turn) == pytest.approx(math.cos(end), abs=1e-9)
    assert math.sin(start + turn) == pytest.approx(math.sin(end), abs=1e-9)

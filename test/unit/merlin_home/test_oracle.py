"""The oracle against cases computed by hand."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from merlin_home.motion_limits import MotionLimits, Profile
from merlin_home.oracle import Oracle
from merlin_home.shortest_path import (
    NoPathError,
    ShortestPaths,
    angle_between,
    bend_angles,
    path_length,
)

LIMITS = MotionLimits(speed=0.5, acceleration=1.0, turn_rate=1.0, turn_acceleration=2.0, radius=0.25)


BOXES = st.tuples(st.integers(5, 70), st.integers(25, 95), st.integers(2, 12), st.integers(2, 12))


def room(rows: int = 80, columns: int = 120) -> np.ndarray:
    """A room of 6 m x 4 m in cells of 5 cm."""
    return np.zeros((rows, columns), dtype=bool)


def paths(occupied: np.ndarray, radius: float = 0.25) -> ShortestPaths:
    return ShortestPaths(occupied, 0.05, (-1.0, -2.0), radius)


def test_a_long_way_is_a_trapezoid() -> None:
    # 0.5 s up to 0.5 m/s (0.125 m), 0.5 s down (0.125 m), 1.75 m at 0.5 m/s = 3.5 s
    profile = Profile(2.0, 0.5, 1.0)
    assert profile.duration == pytest.approx(4.5)
    assert profile.way_at(0.5) == pytest.approx(0.125)
    assert profile.way_at(2.5) == pytest.approx(1.125)
    assert profile.way_at(4.25) == pytest.approx(2.0 - 0.5 * 0.25**2)


def test_a_short_way_is_a_triangle() -> None:
    # 0.16 m at 1 m/s²: peak 0.4 m/s, 0.4 s up and 0.4 s down
    profile = Profile(0.16, 0.5, 1.0)
    assert profile.peak == pytest.approx(0.4)
    assert profile.duration == pytest.approx(0.8)
    assert profile.way_at(0.4) == pytest.approx(0.08)


@given(st.floats(0, 100), st.floats(0.01, 10), st.floats(0.01, 10), st.floats(0, 1), st.floats(0, 1))
def test_a_profile_covers_its_way_once_and_never_backwards(
    way: float, speed: float, acceleration: float, a: float, b: float
) -> None:
    profile = Profile(way, speed, acceleration)
    early, late = sorted([a * profile.duration, b * profile.duration])
    assert profile.way_at(early) <= profile.way_at(late) + 1e-9
    assert profile.way_at(profile.duration) == pytest.approx(way)
    assert profile.peak <= speed


def test_ahead_a_task_is_drive_and_speech() -> None:
    # 2 m at 0.5 m/s and 1 m/s² is 4.5 s; 5 s speech
    oracle = Oracle(paths(room()), LIMITS, speech=5.0)
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
    oracle = Oracle(paths(room()), LIMITS, speech=0.0)
    left = oracle.task((0.0, 0.0), math.radians(170), (-0.5, 0.0))
    right = oracle.task((0.0, 0.0), math.radians(-170), (-0.5, 0.0))
    assert left.time == pytest.approx(right.time)
    assert left.time < 2.0


def test_a_cancelled_task_ends_when_it_is_cancelled() -> None:
    oracle = Oracle(paths(room()), LIMITS, speech=5.0)
    result = oracle.task((0.0, 0.0), 0.0, (2.0, 0.0), cancel_after=2.5)
    assert result.time == 2.5
    assert result.distance == pytest.approx(1.125)
    late = oracle.task((0.0, 0.0), 0.0, (2.0, 0.0), cancel_after=60.0)
    assert late.time == pytest.approx(9.5)


def test_a_task_at_the_robots_place_is_only_speech() -> None:
    oracle = Oracle(paths(room()), LIMITS, speech=5.0, goal_tolerance=0.1)
    assert oracle.task((0.0, 0.0), 1.0, (0.0, 0.0)).time == 5.0
    assert oracle.task((0.0, 0.0), 1.0, (0.05, 0.0)).distance == 0.0


def test_the_way_round_a_wall_touches_its_end() -> None:
    occupied = room()
    occupied[:60, 58:60] = True  # a wall at x = 1.9 … 2.0 from the bottom up to y = 1.0
    route = paths(occupied).path((0.0, 0.0), (3.9, 0.0))
    # Two tangents to discs of 0.25 m round the wall's upper corners, (1.9, 1.0) and (2.0, 1.0), from 1.9 m
    # beside and 1 m below, and the arcs between.
    reach = math.hypot(1.9, 1.0)
    tangent = math.sqrt(reach**2 - 0.25**2)
    arc = math.atan2(1.0, 1.9) + math.asin(0.25 / reach)
    assert path_length(route) == pytest.approx(2 * tangent + 2 * 0.25 * arc + 0.1, abs=0.06)
    assert sum(bend_angles(route)) == pytest.approx(2 * arc, abs=0.1)
    assert min(math.dist(point, (1.95, 1.0)) for point in route) >= 0.2


def test_no_way() -> None:
    occupied = room()
    occupied[:, 60] = True
    with pytest.raises(NoPathError, match="no way"):
        paths(occupied).path((0.0, 0.0), (3.9, 0.0))


def test_a_gap_narrower_than_the_robot_is_no_way() -> None:
    occupied = room()
    occupied[:, 60] = True
    occupied[30:38, 60] = False
    with pytest.raises(NoPathError):
        paths(occupied).path((0.0, 0.0), (3.9, 0.0))
    assert path_length(paths(occupied, 0.1).path((0.0, 0.0), (3.9, 0.0))) == pytest.approx(3.9, abs=0.1)


@given(
    st.lists(BOXES, max_size=5),
    st.floats(-0.4, -0.2),
    st.floats(-1.5, 1.5),
    st.floats(-1.5, 1.5),
)
def test_paths_are_free_and_the_same_length_both_ways(boxes: list, x: float, y: float, goal_y: float) -> None:
    occupied = room()
    for row, column, height, width in boxes:
        occupied[row : row + height, column : column + width] = True
    planner = paths(occupied)
    start, goal = (x, y), (4.6, goal_y)
    try:
        there = planner.path(start, goal)
    except NoPathError:
        with pytest.raises(NoPathError):
            planner.path(goal, start)
        return
    back = planner.path(goal, start)
    assert path_length(there) == pytest.approx(path_length(back), abs=1e-6)
    assert path_length(there) >= math.dist(start, goal) - 1e-9
    for row, column in np.argwhere(occupied):
        centre = (-1.0 + (column + 0.5) * 0.05, -2.0 + (row + 0.5) * 0.05)
        for a, b in zip(there, there[1:]):
            # the sampling of lines may cut the corner of a cell
            assert _distance(centre, a, b) >= 0.25 - 0.05


def _distance(point: tuple, a: tuple, b: tuple) -> float:
    along = (point[0] - a[0]) * (b[0] - a[0]) + (point[1] - a[1]) * (b[1] - a[1])
    share = min(1.0, max(0.0, along / max(1e-12, math.dist(a, b) ** 2)))
    return math.dist(point, (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])))


@given(st.floats(-10, 10), st.floats(-10, 10))
def test_turns_are_the_smaller_ones(start: float, end: float) -> None:
    turn = angle_between(start, end)
    assert abs(turn) <= math.pi + 1e-9
    assert math.cos(start + turn) == pytest.approx(math.cos(end), abs=1e-9)
    assert math.sin(start + turn) == pytest.approx(math.sin(end), abs=1e-9)

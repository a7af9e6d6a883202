# SPDX-License-Identifier: Apache-2.0
"""The map: where the robot was, what it sees beside the map, and why it stands."""

from typing import Any, List, Tuple

import numpy
import pytest
from geometry_msgs.msg import Quaternion, Transform, Vector3
from nav_msgs.msg import OccupancyGrid
from sensor_msgs.msg import LaserScan

from merlin_monitor.panels.map import scan_points
from merlin_monitor.state.map_section import LONGEST_TRAIL, MapSection, near_cells
from merlin_monitor.state.state_tree import StateTree
from merlin_monitor.text.phrase import in_english

HALF = 0.5**0.5  # of a quaternion that turns by a quarter


def section() -> Tuple[StateTree, MapSection]:
    tree = StateTree()
    found = MapSection(tree)
    grid = OccupancyGrid(data=[100] * 20 + [0] * 380)  # a wall along the south
    grid.info.width, grid.info.height, grid.info.resolution = 20, 20, 0.5
    grid.info.origin.position.x = -1.0
    found.grid(grid)
    return tree, found


def stands(tree: StateTree) -> str:
    return in_english(tree.get("map", "stands") or "")


def test_the_trail_has_steps_an_end_and_no_jumps() -> None:
    tree, found = section()
    for step in range(11):
        found.robot((0.06 * step, 3.0, 0.0))
    assert [point[0] for point in tree.get("map", "trail").values()] == [0.0, 0.18, 0.36, 0.54]
    for step in range(2 * LONGEST_TRAIL):
        found.robot((0.6 + 0.2 * step, 3.0, 0.0))
    assert len(tree.get("map", "trail")) == LONGEST_TRAIL
    found.robot((0.0, 3.0, 0.0))
    assert list(tree.get("map", "trail").values()) == [[0.0, 3.0]]


def test_each_robot_of_a_plan_has_a_way_a_goal_and_a_trail() -> None:
    tree, found = section()
    for step in range(3):
        found.robots({"ann": (0.2 * step, 1.0, 0.0), "bob": (4.0, 2.0, 0.0)})
    found.track("ann").goal((2.0, 1.0, 0.5))
    found.track("ann").path([(0.4, 1.0), (2.0, 1.0)])
    ways = tree.get("map", "ways")
    assert list(ways["ann"]["trail"].values()) == [[0.0, 1.0], [0.2, 1.0], [0.4, 1.0]]
    assert (ways["ann"]["goal"], ways["ann"]["path"]) == ([2.0, 1.0, 0.5], [[0.4, 1.0], [2.0, 1.0]])
    assert list(ways["bob"]) == ["trail"]
    assert not tree.get("map", "trail"), "the robot of the own namespace is another one"


def test_only_what_the_map_does_not_have_is_shown_as_seen() -> None:
    tree, found = section()
    points = numpy.array([(1.0, 0.3), (2.0, 5.0), (50.0, 5.0)])
    found.seen(points)
    assert tree.get("map", "seen") == [[2.0, 5.0]]
    found.seen(numpy.zeros((0, 2)))
    assert tree.get("map", "seen") == []
    assert near_cells([], 0, 0, 1.0) is None


@pytest.mark.parametrize(
    ("seen", "words"),
    [
        ([(4.0, 3.2)], "stands since 10.0 s: something that the map does not have stands at the goal"),
        ([(1.6, 3.1)], "stands since 10.0 s: something that the map does not have is in the way"),
        ([], "stands since 10.0 s on the way to its goal; nothing in the way is seen"),
    ],
)
def test_why_it_stands(seen: List[Any], words: str) -> None:
    tree, found = section()
    found.robot((1.0, 3.0, 0.0), 10.0)
    found.goal((4.0, 3.0, 0.0))
    found.path([(1.0 + 0.5 * step, 3.0) for step in range(7)])
    found.seen(numpy.array(seen).reshape(-1, 2))
    found.look(12.0)
    assert stands(tree) == ""
    found.look(14.0)
    assert stands(tree) == words
    found.robot((1.2, 3.0, 0.0), 14.5)
    found.look(15.0)
    assert stands(tree) == ""


def test_what_it_stood_before_the_goal_turns_and_a_held_base_are_no_standing() -> None:
    tree, found = section()
    found.robot((1.0, 3.0, 0.0), 10.0)
    found.goal((4.0, 3.0, 0.0), 60.0)
    found.look(62.0)
    assert stands(tree) == "", "it stood before it was to drive"
    for second in range(62, 70):
        found.robot((1.0, 3.0, 0.3 * (second - 61)), float(second))
        found.look(second + 0.5)
        assert stands(tree) == "", "it turns"
    found.look(73.0)
    assert stands(tree).startswith("stands since 69.0 s")
    tree.set("guard", "state", "stopped")
    found.look(80.0)
    assert stands(tree) == "", "the base is held, which the headline says"
    tree.set("guard", "state", "passing")
    found.look(82.0)
    assert stands(tree) == ""
    found.look(84.0)
    assert stands(tree).startswith("stands since 80.0 s")


def test_why_a_drive_ended_stays_until_the_next_one() -> None:
    tree, found = section()
    found.robot((1.0, 3.0, 0.0), 10.0)
    found.goal((4.0, 3.0, 0.0))
    found.ended("Something stands in the way.", 20.0)
    assert stands(tree) == "did not get there: Something stands in the way."
    found.goal((4.0, 3.0, 0.0))
    found.look(12.0)
    assert stands(tree) == ""
    found.ended("", 21.0)
    assert stands(tree) == ""


@pytest.mark.parametrize(
    ("rotation", "left"),
    [(Quaternion(z=HALF, w=HALF), (-1.0, 1.0)), (Quaternion(x=HALF, y=HALF), (3.0, 1.0))],
    ids=["upright", "upside down"],
)
def test_a_scan_in_the_maps_frame(rotation: Quaternion, left: Tuple[float, float]) -> None:
    scan = LaserScan(angle_min=0.0, angle_increment=numpy.pi / 2, range_min=0.1, range_max=5.0)
    scan.ranges = [1.0, 2.0, float("inf"), 0.01]
    points = scan_points(scan, Transform(Vector3(1.0, 1.0, 0.3), rotation))
    assert numpy.allclose(points, [(1.0, 2.0), left])

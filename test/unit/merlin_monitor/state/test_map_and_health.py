# SPDX-License-Identifier: Apache-2.0
"""The map's picture, the people on it, and silent parts."""

import math
import struct
import zlib
from typing import Any, Dict, Tuple

import numpy
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Point, Pose, PoseArray, Quaternion
from hypothesis import given
from hypothesis import strategies as st
from merlin_msgs.msg import SimPeople, SimPerson
from messages import Reported
from nav_msgs.msg import OccupancyGrid

from merlin_monitor.history.pictures import Pictures
from merlin_monitor.state.health_section import HealthSection
from merlin_monitor.state.map_section import LONGEST_PATH, MapSection, grid_picture
from merlin_monitor.state.state_tree import StateTree
from merlin_monitor.text.phrase import in_english


def opacity(png: bytes) -> numpy.ndarray:
    """Reads the opacity out of a picture of grey and opacity, without filters."""
    assert png.startswith(b"\x89PNG\r\n\x1a\n")
    chunks: Dict[bytes, bytes] = {}
    at = 8
    while at < len(png):
        (size,) = struct.unpack(">I", png[at : at + 4])
        kind, body = png[at + 4 : at + 8], png[at + 8 : at + 8 + size]
        assert struct.unpack(">I", png[at + 8 + size : at + 12 + size])[0] == zlib.crc32(kind + body)
        chunks[kind] = body
        at += 12 + size
    width, height = struct.unpack(">II", chunks[b"IHDR"][:8])
    rows = numpy.frombuffer(zlib.decompress(chunks[b"IDAT"]), numpy.uint8).reshape(height, 1 + 2 * width)
    return rows[:, 2::2]


def test_north_is_up_and_walls_are_opaque() -> None:
    picture = opacity(grid_picture([0, 100, -1, 50], 2, 2))
    assert picture.tolist() == [[40, 127], [0, 255]]


def test_a_grid_that_contradicts_itself_is_unknown() -> None:
    assert opacity(grid_picture([0, 0, 0], 2, 2)).shape == (1, 1)
    assert opacity(grid_picture([], 0, 0)).shape == (1, 1)


def test_the_map_is_fetched_anew_when_it_changes() -> None:
    tree = StateTree()
    pictures = Pictures()
    section = MapSection(tree, pictures)
    message = OccupancyGrid(data=[0])
    message.info.width = message.info.height = 1
    message.info.resolution = 0.5
    section.grid(message)
    first = tree.get("map", "grid", "version")
    section.grid(message)
    assert tree.get("map", "grid", "version") == first and tree.get("map", "grid", "width") == 0.5
    message.data = [100]
    section.grid(message)
    assert tree.get("map", "grid", "version") != first
    assert pictures.get("map") and pictures.get("map", first) is None


def turned_grid(yaw: float = 0.0) -> OccupancyGrid:
    """4 x 2 m from (1, 2) on; its first cell is occupied."""
    message = OccupancyGrid(data=[100] + [0] * 799)
    message.info.width, message.info.height, message.info.resolution = 40, 20, 0.1
    message.info.origin = Pose(
        Point(1.0, 2.0, 0.0), Quaternion(z=math.sin(yaw / 2), w=math.cos(yaw / 2) if yaw else 0.0)
    )
    return message


@pytest.mark.parametrize(
    ("yaw", "box"),
    [
        (0.0, (1.0, 2.0, 4.0, 2.0)),
        (math.pi / 2, (-1.0, 2.0, 2.0, 4.0)),
        (math.pi, (-3.0, 0.0, 4.0, 2.0)),
        (-math.pi / 4, (1.0, 2.0 - math.sqrt(8.0), 3 * math.sqrt(2.0), 3 * math.sqrt(2.0))),
    ],
)
def test_what_a_turned_map_covers_and_has(yaw: float, box: Tuple[float, ...]) -> None:
    tree = StateTree()
    section = MapSection(tree)
    section.grid(turned_grid(yaw))
    found = tree.get("map", "grid")
    assert found["yaw"] == pytest.approx(yaw) and (found["x"], found["y"]) == (1.0, 2.0)
    assert tuple(found["box"].values()) == pytest.approx(box)
    # What is seen at the occupied cell is that; beyond the map nothing is known.
    turn = numpy.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    own, other, beyond = numpy.array([(0.05, 0.05), (3.5, 1.5), (-0.05, 1.0)]) @ turn.T + (1.0, 2.0)
    section.seen(numpy.array([own, other]))
    assert tree.get("map", "seen") == [[round(other[0], 2), round(other[1], 2)]]
    section.seen(numpy.array([own, beyond]))
    assert tree.get("map", "seen") == []


@pytest.mark.parametrize(
    ("path", "number", "said"),
    [
        ("origin.position.x", math.nan, "its origin is at nan, 2 m"),
        ("origin.position.y", math.inf, "its origin is at 1, inf m"),
        ("origin.orientation.w", math.nan, "the orientation of its origin is not a turn on the floor"),
        ("origin.orientation.w", 2.0, "the orientation of its origin is not a turn on the floor"),
        ("origin.orientation.x", 1.0, "the orientation of its origin is not a turn on the floor"),
        ("resolution", 0.0, "its resolution is 0 m"),
        ("resolution", -0.1, "its resolution is -0.1 m"),
        ("resolution", math.nan, "its resolution is nan m"),
        ("width", 41, "it has not the 41 x 20 cells of its size"),
        ("width", 0, "it has not the 0 x 20 cells of its size"),
    ],
)
def test_a_map_that_cannot_be_drawn_says_why_until_another_comes(path: str, number: float, said: str) -> None:
    tree = StateTree()
    section = MapSection(tree)
    section.grid(turned_grid())
    message = turned_grid()
    *way, field = path.split(".")
    part = message.info
    for name in way:
        part = getattr(part, name)
    setattr(part, field, number)
    section.grid(message)
    assert in_english(tree.get("map", "trouble")) == f"the map cannot be drawn: {said}"
    assert tree.get("map", "grid") is None
    section.seen(numpy.array([(1.0, 1.0)]))
    assert tree.get("map", "seen") == [[1.0, 1.0]]
    section.grid(turned_grid())
    assert not tree.get("map", "trouble") and tree.get("map", "grid", "width") == 4.0


def test_people_of_every_kind_of_message() -> None:
    tree = StateTree()
    section = MapSection(tree)
    section.people(PoseArray(poses=[Pose(position=Point(1, 2, 0))]))
    assert tree.get("map", "people") == [[1.0, 2.0]]
    there = SimPerson(name="ann", state=SimPerson.STANDING, x=3.0, y=4.0)
    gone = SimPerson(state=SimPerson.ABSENT)
    section.people(SimPeople(people=[there, gone]))
    assert tree.get("map", "people") == [[3.0, 4.0, "ann"]]


@given(st.integers(0, 2000))
def test_a_path_of_any_length_keeps_its_ends(count: int) -> None:
    tree = StateTree()
    MapSection(tree).path([(float(n), 0.0) for n in range(count)])
    path = tree.get("map", "path")
    assert len(path) <= LONGEST_PATH + 1
    assert not count or (path[0][0] == 0.0 and path[-1][0] == count - 1)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_place_that_is_nowhere_is_not_shown(value: float) -> None:
    tree = StateTree()
    section = MapSection(tree)
    section.people(PoseArray(poses=[Pose(position=Point(value, 2, 0)), Pose(position=Point(1, 2, 0))]))
    section.path([(value, 0.0), (1.0, 0.0), (0.0, value)])
    section.goal((0.0, 0.0, value))
    assert tree.get("map", "people") == [[1.0, 2.0]]
    assert tree.get("map", "path") == [[1.0, 0.0]]
    assert tree.get("map", "goal") is None


PLACE = {"x": "1.5", "y": 2}
NO_PLACES = [None, "kitchen", 1.0, [], {"x": 1}, {"x": "1", "y": None}, {"x": []}, {"x": "nan", "y": 2}]
SHAPES = st.sampled_from([*NO_PLACES, PLACE])


@given(SHAPES | st.dictionaries(st.sampled_from(["x", "kitchen"]), SHAPES, max_size=2))
def test_points_of_interest_of_any_shape(parameter: Any) -> None:
    tree = StateTree()
    names = MapSection(tree).points(parameter)
    places = parameter.items() if isinstance(parameter, dict) else ()
    assert names == [name for name, place in places if place == PLACE]
    assert tree.get("map", "points") == {name: [1.5, 2.0, 0.0] for name in names}


def test_points_of_interest() -> None:
    tree = StateTree()
    names = MapSection(tree).points({"kitchen": {"x": 1, "y": 2.5, "yaw": 0.1}, "odd": {"x": "?"}, "more": 3})
    assert names == ["kitchen"] and tree.get("map", "points") == {"kitchen": [1.0, 2.5, 0.1]}


def diagnostics(level: int, message: str = "") -> DiagnosticArray:
    return DiagnosticArray(status=[DiagnosticStatus(level=level, name="arm", message=message)])


def test_health_changes_are_events_and_silence_is_one() -> None:
    tree, reported = StateTree(), Reported()
    health = HealthSection(tree, reported)
    health.diagnostics(diagnostics(DiagnosticStatus.OK), 0.0, 0.0)
    health.diagnostics(diagnostics(DiagnosticStatus.ERROR, "no power"), 1.0, 1.0)
    health.check_silence(3.0, 3.0)
    health.check_silence(10.0, 10.0)
    health.check_silence(11.0, 11.0)
    assert tree.get("health", "parts", "arm", "silent") is True
    health.diagnostics(diagnostics(DiagnosticStatus.OK, "ready"), 12.0, 12.0)
    assert reported.texts == ["arm: error: no power", "arm has fallen silent", "arm is heard again: ready"]


def test_a_part_that_goes_to_and_fro_does_not_fill_the_history() -> None:
    reported = Reported()
    section = HealthSection(StateTree(), reported)

    def report(level: int, wall: float) -> None:
        status = DiagnosticStatus(name="world", message=f"at {wall:.0f}", level=level)
        section.diagnostics(DiagnosticArray(status=[status]), wall, wall)

    for second in range(300):
        report((DiagnosticStatus.OK, DiagnosticStatus.WARN)[second % 2], float(second))
    assert 1 < len(reported.texts) <= 6, reported.texts
    # A worse level is reported at once, and so is the level that lasts.
    report(DiagnosticStatus.ERROR, 300.0)
    assert reported.texts[-1] == "world: error: at 300"
    report(DiagnosticStatus.WARN, 301.0)
    report(DiagnosticStatus.OK, 302.0)
    assert reported.texts[-1] == "world: warning: at 301"
    for second in range(303, 365):
        report(DiagnosticStatus.OK, float(second))
    assert reported.texts[-1].startswith("world: ok: at 36")

# SPDX-License-Identifier: Apache-2.0
"""rviz: markers of the state, the point that a click means, the configuration, and the start without rviz."""

import os
import queue
import shlex
import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import rospkg
import yaml
from roslaunch.config import ROSLaunchConfig
from roslaunch.core import RLException
from roslaunch.xmlloader import XmlLoader
from visualization_msgs.msg import Marker, MarkerArray

from merlin_monitor.rviz.markers import HEADLINE, LONGEST_LINE, MarkerPublisher, headline, markers
from merlin_monitor.rviz.rviz_node import NoPlace, nearest
from merlin_monitor.state.inbox import Inbox
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_ros.publishing import OnSubscriber
from merlin_test import LONG

PACKAGE = Path(rospkg.RosPack().get_path("merlin_monitor"))
LAUNCH = Path(rospkg.RosPack().get_path("merlin"), "launch")
WINDOW = PACKAGE / "scripts" / "rviz_window"
TOPICS = yaml.safe_load(Path(__file__).parents[3].joinpath("data", "rviz_topics.yaml").read_text())
#: Class of a display → the field with its topic, and the topic's type.
DISPLAYS = {
    "rviz/Map": ("Topic", "nav_msgs/OccupancyGrid"),
    "rviz/LaserScan": ("Topic", "sensor_msgs/LaserScan"),
    "rviz/Path": ("Topic", "nav_msgs/Path"),
    "rviz/MarkerArray": ("Marker Topic", "visualization_msgs/MarkerArray"),
}
POINTS = {"kitchen": [1.0, 2.0, 0.0], "dorm_room": [1.0, 4.0, 1.57]}


def step(text, state):
    return {"words": {"english": text}, "state": state}


def plan_of(*steps):
    return {"order": [str(number) for number in range(len(steps))], "steps": dict(zip("0123456789", steps))}


STATE = {
    "map": {
        "points": POINTS,
        "people": [[3.0, 1.0, "ann"], [5.0, 1.0]],
        "goal": [1.0, 4.0, 1.57],
        "grid": {"x": -1.0, "y": 0.0, "width": 10.0, "height": 8.0},
    },
    "now": {"executor": {"words": [{"english": "kitchen checked"}]}},
    "plan": plan_of(
        step("(navigate a b)", "succeeded"),
        step("(navigate b kitchen)", "running"),
        step("(ask kitchen)", "waiting"),
    ),
}


def texts(drawn, name):
    return [marker.text for marker in drawn if marker.ns == name]


def test_points_people_goal_and_plan_are_drawn() -> None:
    drawn = markers(STATE, "map")
    assert drawn[0].action == Marker.DELETEALL, "what is gone does not stay"
    assert [marker.action for marker in drawn[1:]] == [Marker.ADD] * (len(drawn) - 1)
    assert len({marker.id for marker in drawn}) == len(drawn)
    assert {marker.header.frame_id for marker in drawn} == {"map"}
    assert sorted(texts(drawn, "point names")) == ["dorm room", "kitchen"]
    assert texts(drawn, "people's names") == ["ann"]
    assert [(each.pose.position.x, each.pose.position.y) for each in drawn if each.ns == "people"] == [
        (3.0, 1.0),
        (5.0, 1.0),
    ]
    (arrow,) = [marker for marker in drawn if marker.ns == "goal"]
    assert arrow.type == Marker.ARROW
    assert (arrow.pose.position.x, arrow.pose.position.y) == (1.0, 4.0)
    assert arrow.pose.orientation.z == pytest.approx(0.7068, abs=1e-3)
    (plan,) = [marker for marker in drawn if marker.ns == "plan"]
    assert plan.text.splitlines() == [
        "goal: kitchen checked",
        "now: (navigate b kitchen)",
        "then: (ask kitchen)",
    ]
    assert plan.pose.position.x == 4.0, "in the middle of the map"
    assert plan.pose.position.y - 3 * HEADLINE / 2 > 8.0, "above the map, and hides nothing of it"
    for marker in drawn[1:]:
        assert min(marker.color.a, marker.scale.z) > 0.0, (
            "rviz shows nothing of size 0, nor what is transparent"
        )


@pytest.mark.parametrize(
    "state", [{}, {"map": {}, "now": {}, "plan": {}}, {"map": {"goal": None}, "now": {"executor": {}}}]
)
def test_nothing_is_drawn_where_nothing_is_known(state: dict) -> None:
    assert [marker.action for marker in markers(state, "map")] == [Marker.DELETEALL]


def test_a_long_plan_is_cut() -> None:
    steps = [
        step(f"(visit {'x' * 200})", "waiting"),
        *[step(f"(go {number})", "waiting") for number in range(5)],
    ]
    lines = list(headline({**STATE, "plan": plan_of(*steps)}))
    assert [line[:7] for line in lines] == ["goal: k", "then: (", "then: (", "then: (", "and 3 m"]
    assert len(lines[1]) == LONGEST_LINE and lines[1].endswith("...")
    assert list(headline({**STATE, "now": {"executor": {"words": []}}})) == [], "an old plan does not count"


def test_the_state_of_the_monitor_is_what_is_drawn() -> None:
    model = MonitorModel(Inbox())
    model.map.points({name: {"x": x, "y": y, "yaw": yaw} for name, (x, y, yaw) in POINTS.items()})
    model.map.goal((1.0, 4.0, 1.57))
    model.map.people(
        SimpleNamespace(people=[SimpleNamespace(name="ann", position=SimpleNamespace(x=3.0, y=1.0))])
    )
    drawn = markers(model.tree.snapshot()[1], "map")
    assert sorted(texts(drawn, "point names")) == ["dorm room", "kitchen"]
    assert texts(drawn, "people's names") == ["ann"]
    assert [marker.ns for marker in drawn].count("goal") == 1


class Topic:
    """Stands in for the publisher; the thread that draws waits until the test says how many listen."""

    def __init__(self) -> None:
        self._listeners: queue.Queue[int] = queue.Queue()
        self.sent: queue.Queue[list] = queue.Queue()

    def advertise(self, name: str, kind: type, listener: OnSubscriber, **_: Any) -> "Topic":
        self._listener = listener
        return self

    def subscribe(self) -> None:
        """A subscriber comes."""
        self._listener.peer_subscribe("merlin/markers", None, None)

    def get_num_connections(self) -> int:
        found = self._listeners.get(timeout=LONG)
        self._listeners.task_done()
        return found

    def asked(self, listeners: int) -> None:
        """Waits until the thread has asked, for what has changed until now, and answers."""
        self._listeners.put(listeners)
        self._listeners.join()

    def publish(self, message: MarkerArray) -> None:
        self.sent.put([marker.text for marker in message.markers if marker.ns == "point names"])


def test_who_listens_gets_what_is_shown_and_then_what_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    topic = Topic()
    monkeypatch.setattr("rospy.Publisher", topic.advertise)
    model = MonitorModel(Inbox())
    MarkerPublisher(model, "map")
    model.map.points({"kitchen": {"x": 1.0, "y": 2.0}})
    topic.asked(0)
    for _ in range(2):  # also when nothing has changed since the last one came
        topic.subscribe()
        topic.asked(1)
        assert topic.sent.get(timeout=LONG) == ["kitchen"]
    model.tree.set("map", "trail", {"1": [1.0, 2.0]})  # is not drawn
    topic.asked(1)
    topic.subscribe()
    topic.asked(1)
    assert topic.sent.get(timeout=LONG) == ["kitchen"]
    model.map.points({"bath": {"x": 1.0, "y": 2.0}})
    topic.asked(1)
    assert topic.sent.get(timeout=LONG) == ["bath"]
    model.map.points({"hall": {"x": 1.0, "y": 2.0}})
    topic.asked(0)
    topic.subscribe()
    topic.asked(1)
    assert topic.sent.get(timeout=LONG) == ["hall"]
    assert topic.sent.empty(), "nothing is published without a subscriber"


def test_the_nearest_point_is_meant() -> None:
    assert nearest(POINTS, 1.2, 2.9, 2.0) == "kitchen"
    assert nearest(POINTS, 1.2, 3.1, 2.0) == "dorm_room"
    assert nearest(POINTS, 1.0, 0.0, 2.0) == "kitchen", "at the limit"


@pytest.mark.parametrize(
    ("points", "x", "said"),
    [
        (POINTS, 3.1, r"within 2 m of \(3.10, 2.00\); the nearest is kitchen, 2.10 m away"),
        (POINTS, float("nan"), "finite"),
        (POINTS, float("inf"), "finite"),
        ({}, 1.0, "there are no points of interest"),
    ],
)
def test_a_click_beside_all_points_is_refused(points: dict, x: float, said: str) -> None:
    with pytest.raises(NoPlace, match=said):
        nearest(points, x, 2.0, 2.0)


def configuration() -> dict:
    return yaml.safe_load((PACKAGE / "config" / "merlin.rviz").read_text())["Visualization Manager"]


def test_each_display_shows_a_topic_of_its_type() -> None:
    found = {}
    for display in configuration()["Displays"]:
        assert display["Enabled"] is True
        if display["Class"] == "rviz/RobotModel":
            assert display["Robot Description"] == "robot_description"
            continue
        field, kind = DISPLAYS[display["Class"]]
        found[display[field]] = kind
    assert found == TOPICS


def test_the_frame_is_the_map_and_a_click_is_a_goal_of_ours() -> None:
    found = configuration()
    assert found["Global Options"]["Fixed Frame"] == "map"
    (tool,) = [tool for tool in found["Tools"] if tool["Class"] == "rviz/SetGoal"]
    assert tool["Topic"] == "merlin/clicked_goal", "not the drive's own goal: the Executor is not passed over"


def window(tmp_path: Path, *words: str, **environment: str) -> "subprocess.CompletedProcess[str]":
    kept = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    return subprocess.run(
        ["/bin/sh", str(WINDOW), *words],
        capture_output=True,
        text=True,
        env={**kept, "PATH": str(tmp_path), **environment},
    )


def stand_in(tmp_path: Path) -> Path:
    program = tmp_path / "rviz"
    program.write_text('#!/bin/sh\necho "rviz $*"\n')
    program.chmod(0o755)
    return program


def test_without_rviz_or_a_screen_it_says_so(tmp_path: Path) -> None:
    done = window(tmp_path, "--check", DISPLAY=":0")
    assert done.returncode == 2 and "rviz is not installed: sudo apt-get install rviz" in done.stderr
    program = stand_in(tmp_path)
    done = window(tmp_path, "--check")
    assert done.returncode == 2 and "DISPLAY is not set" in done.stderr
    done = window(tmp_path, "--check", DISPLAY=":0")
    assert (done.returncode, done.stdout) == (0, f"{program}\n")
    assert window(tmp_path, "-d", "x.rviz", DISPLAY=":0").stdout == "rviz -d x.rviz\n"


def load(file: str, **arguments: str) -> ROSLaunchConfig:
    inner = "".join(f'<arg name="{name}" value="{value}"/>' for name, value in arguments.items())
    config = ROSLaunchConfig()
    text = f'<launch><include file="{LAUNCH / file}">{inner}</include></launch>'
    XmlLoader(resolve_anon=False).load_string(text, config)
    return config


@pytest.mark.parametrize("file", ["home.launch", "restaurant.launch", "include/application.launch"])
def test_an_application_starts_it_when_asked_to(
    file: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert not {"rviz", "rviz_markers"} & {node.name for node in load(file).nodes}
    stand_in(tmp_path)
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    nodes = {node.name: node for node in load(file, rviz="true").nodes}
    assert shlex.split(nodes["rviz"].args) == ["-d", f"{PACKAGE}/config/merlin.rviz"]
    assert "rviz_markers" in nodes
    (window,) = [node for node in load("include/rviz.launch", config="/my own/a.rviz").nodes if node.args]
    assert shlex.split(window.args) == ["-d", "/my own/a.rviz"]


def test_without_rviz_nothing_is_started(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(RLException, match="rviz_window"):
        load("home.launch", rviz="true")
    assert [node.name for node in load("include/rviz.launch", window="false").nodes] == ["rviz_markers"]

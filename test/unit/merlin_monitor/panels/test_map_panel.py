# SPDX-License-Identifier: Apache-2.0
"""The panel of the map: names of robots and frames come with messages, and may be anything."""

import threading
from typing import Any, Callable, Dict, Iterator, List, Tuple

import genpy
import pytest
import rospy
import tf2_ros
from geometry_msgs.msg import PoseStamped, TransformStamped
from merlin_msgs.msg import ListenActionResult
from move_base_msgs.msg import MoveBaseActionGoal, MoveBaseActionResult
from nav_msgs.msg import Path
from sensor_msgs.msg import LaserScan
from sound_play.msg import SoundRequest

from merlin_monitor.listeners.panel import Panel, Request
from merlin_monitor.listeners.ros_system import RosSystem, TopicGraph
from merlin_monitor.panel_board import PanelBoard
from merlin_monitor.panels.map import OLD_POSITION, MapPanel
from merlin_monitor.panels.said import SaidPanel
from merlin_monitor.state.freshness import Source
from merlin_monitor.state.inbox import DirectInbox, Inbox
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_monitor.terminal.terminal_view import lines
from merlin_monitor.web.page_control import ControlError, RobotRequests
from merlin_ros.robot_values import ROBOTS
from merlin_test import LONG

#: As of a message with a zero byte, and of one that is not UTF-8.
STRANGE = ("a\0b", "\udc80", "a b", "", "x" * 10_000)


class Subscriber:
    """A subscriber that a test calls."""

    def __init__(self, topic: str, receive: Callable[[Any], object], all_of: List["Subscriber"]) -> None:
        self.topic = self.resolved_name = topic
        self.receive, self._all = receive, all_of
        self.connections = 1

    def get_num_connections(self) -> int:
        return self.connections

    def unregister(self) -> None:
        self._all.remove(self)


class System(RosSystem):
    """What panels ask, without ROS; transforms are those of tf2."""

    namespace = "/"

    def __init__(self) -> None:
        self.subscribers: List[Subscriber] = []
        self.buffer = tf2_ros.BufferCore(genpy.Duration(5))

    def parameter(self, name: str, default: Any = None) -> Any:
        return default

    def resolve(self, name: str) -> str:
        return f"/{name}"

    def time(self) -> float:
        return 100.0

    def subscribe(self, topic: str, *arguments: Any, **_: Any) -> Subscriber:
        self.subscribers.append(Subscriber(topic, arguments[-1], self.subscribers))
        return self.subscribers[-1]

    def transforms(self) -> Callable[[str, str], Any]:
        return lambda target, source: self.buffer.lookup_transform_core(target, source, genpy.Time(0))

    def graph(self) -> TopicGraph:
        results = [each.topic for each in self.subscribers if each.topic.endswith("move_base/result")]
        nodes = {topic: [topic.replace("move_base/result", "navigation")] for topic in results}
        return TopicGraph(nodes, {})

    def of(self, robot: str) -> List[Subscriber]:
        return [each for each in self.subscribers if each.topic.startswith(f"/{robot}/")]


@pytest.fixture
def panel() -> Iterator[Tuple[MapPanel, System]]:
    system = System()
    inbox = Inbox()
    state = MonitorModel(inbox)
    inbox.start()
    yield MapPanel(state, system), system
    inbox.stop()


def name_robots(panel: MapPanel, *names: str) -> None:
    robots: Dict[str, Any] = {name: {"away": "", "does": []} for name in names}
    panel.state.tree.set("robots", "robots", robots)


def done(panel: MapPanel) -> None:
    """Waits until the model has taken what it was given."""
    taken = threading.Event()
    panel.state.inbox.put(taken.set)
    assert taken.wait(LONG)


def drive(name: str, x: float, stamp: float, frame: str = "map") -> MoveBaseActionGoal:
    """A goal; without a name it is as rviz sends it."""
    message = MoveBaseActionGoal()
    message.header.stamp = rospy.Time(stamp)
    if name:
        message.goal_id.id, message.goal_id.stamp = name, rospy.Time(stamp)
    target = message.goal.target_pose
    target.header.frame_id, target.pose.position.x, target.pose.orientation.w = frame, x, 1.0
    return message


def drive_ends(name: str, sent: float, at: float) -> MoveBaseActionResult:
    message = MoveBaseActionResult()
    message.header.stamp = rospy.Time(at)
    message.status.goal_id.id, message.status.goal_id.stamp = name, rospy.Time(sent)
    return message


def way(x: float, at: float) -> Path:
    message = Path(poses=[PoseStamped()])
    message.header.stamp, message.poses[0].pose.position.x = rospy.Time(at), x
    return message


def shown_after(made: MapPanel, system: System, *messages: Any, robot: str = "") -> Tuple[Any, Any]:
    """The goal and the path of a robot after messages of move_base, in the order in which they are read."""
    topics = {MoveBaseActionGoal: "goal", MoveBaseActionResult: "result", Path: "plan"}
    below = f"/{robot}/" if robot else ""
    receive = {each.topic: each.receive for each in system.subscribers}
    for message in messages:
        receive[f"{below}move_base/{topics[type(message)]}"](message)
    done(made)
    place = ("map", "ways", robot) if robot else ("map",)
    return made.state.tree.get(*place, "goal"), made.state.tree.get(*place, "path")


HALL = [1.0, 0.0, 0.0]
KITCHEN = [2.0, 0.0, 0.0]


@pytest.mark.parametrize("robot", ["", "ann"])
@pytest.mark.parametrize("name", ["b", ""])
def test_the_goal_on_the_map_is_that_which_runs_whichever_topic_is_read_first(
    panel: Tuple[MapPanel, System], name: str, robot: str
) -> None:
    made, system = panel
    name_robots(made, "ann")
    made.look({})
    first, second = drive("a", 1.0, 10.0), drive(name, 2.0, 20.0)
    assert shown_after(made, system, first, robot=robot)[0] == HALL
    after = second, way(2.0, 21.0), drive_ends("a", 10.0, 20.0)
    assert shown_after(made, system, *after, robot=robot) == (KITCHEN, [[2.0, 0.0]])
    assert shown_after(made, system, drive_ends("b", 20.0, 30.0), robot=robot) == (None, [])
    third = drive(name and "c", 1.0, 40.0)
    assert shown_after(made, system, drive_ends("c", 40.0, 50.0), third, robot=robot)[0] is None


def test_an_older_goal_of_another_client_is_shown_only_when_the_clock_began_anew(
    panel: Tuple[MapPanel, System],
) -> None:
    made, system = panel
    assert shown_after(made, system, drive("b", 2.0, 20.0), drive("a", 1.0, 10.0))[0] == KITCHEN
    before = drive("c", 2.0, 2 * system.time()), drive_ends("c", 2 * system.time(), 200.0)
    assert shown_after(made, system, *before, drive("", 1.0, 30.0))[0] == HALL


def test_a_way_that_is_read_after_the_end_of_its_drive_is_not_shown(panel: Tuple[MapPanel, System]) -> None:
    made, system = panel
    late = drive("a", 1.0, 10.0), drive_ends("a", 10.0, 20.0), way(1.0, 19.0)
    assert shown_after(made, system, *late) == (None, [])
    early = way(2.0, 21.0), drive("b", 2.0, 20.5)
    assert shown_after(made, system, *early) == (KITCHEN, [[2.0, 0.0]])


def test_a_goal_in_another_frame_is_shown_in_that_of_the_map(panel: Tuple[MapPanel, System]) -> None:
    made, system = panel
    assert shown_after(made, system, drive("a", 1.0, 10.0, "odom"))[0] is None
    transform = TransformStamped(child_frame_id="odom")
    transform.header.frame_id, transform.header.stamp = "map", rospy.Time(11.0)
    transform.transform.translation.y = 3.0
    transform.transform.rotation.z = transform.transform.rotation.w = 0.5**0.5  # a quarter turn
    system.buffer.set_transform(transform, "")
    for name, frame in (("b", "odom"), ("c", "/odom")):
        assert shown_after(made, system, drive(name, 1.0, 12.0, frame))[0] == [0.0, 4.0, 1.571]


def test_a_scan_is_shown_whose_frame_begins_with_a_slash(panel: Tuple[MapPanel, System]) -> None:
    made, system = panel
    transform = TransformStamped(child_frame_id="laser")
    transform.header.frame_id, transform.transform.rotation.w = "map", 1.0
    system.buffer.set_transform_static(transform, "")
    scan = LaserScan(ranges=[1.0], range_max=2.0)
    scan.header.frame_id = "/laser"
    next(each for each in system.subscribers if each.topic == "scan").receive(scan)
    made.sample()
    done(made)
    assert made.state.tree.get("map", "seen") == [[1.0, 0.0]]


def test_strange_names_of_robots_and_frames_are_not_looked_up(panel: Tuple[MapPanel, System]) -> None:
    made, system = panel
    name_robots(made, "ann", *STRANGE)
    scanned = next(each for each in system.subscribers if each.topic == "scan")
    for name in STRANGE:
        scan = LaserScan(ranges=[1.0], range_max=2.0)
        scan.header.frame_id = name
        scanned.receive(scan)
        made._scan_shown = 0.0  # each is one that is shown
        made.look({})
        made.sample()
    assert len(system.of("ann")) == 5
    assert all(each.topic.isascii() and each.topic.isprintable() for each in system.subscribers)


def test_a_robot_that_is_forgotten_is_no_longer_followed_or_shown(panel: Tuple[MapPanel, System]) -> None:
    made, system = panel
    name_robots(made, "ann", "bob")
    made.look({})
    for robot in ("ann", "bob"):
        made.state.map.track(robot).path([(0.0, 0.0), (1.0, 0.0)])
    made.state.tree.remove("robots", "robots", "ann")
    made.look({})
    done(made)
    assert (len(system.of("ann")), len(system.of("bob"))) == (0, 5)
    assert made.state.tree.keys("map", "ways") == ["bob"]
    name_robots(made, "ann", "bob")
    made.look({})
    assert len(system.of("ann")) == 5


def test_what_robots_say_hear_and_see_has_their_names_from_the_begin(
    panel: Tuple[MapPanel, System], monkeypatch: pytest.MonkeyPatch
) -> None:
    state, system = panel[0].state, panel[1]
    monkeypatch.setattr(system, "parameter", lambda name, default: {ROBOTS: ["ria"]}.get(name, default))
    events: List[Any] = []
    monkeypatch.setattr(state, "report", events.append)
    panel = SaidPanel(state, system)
    send = {each.topic: each.receive for each in system.subscribers}
    send["/ria/robotsound"](SoundRequest(sound=SoundRequest.SAY, arg="Hello."))
    state.tree.set("robots", "robots", {"tom": {"away": "", "does": []}})  # joins later
    panel.look({})
    send = {each.topic: each.receive for each in system.subscribers}
    heard = ListenActionResult()
    heard.result.heard, heard.result.text = True, "no"
    send["/tom/listen/result"](heard)
    send["robotsound"](SoundRequest(sound=SoundRequest.SAY, arg="All stay here."))
    done(panel)
    entries = state.tree.get("said", "entries")
    assert [(each["robot"], each["kind"], each["words"]) for each in entries] == [
        ("", "said", "All stay here."),
        ("tom", "heard", "no"),
        ("ria", "said", "Hello."),
    ]
    texts = [event.text for event in events]
    assert texts == ["ria said “Hello.”", "tom heard “no”", "said “All stay here.”"]
    assert any("tom heard “no”" in line.text for line in lines(state.tree.snapshot()[1], events))


def test_a_position_grows_old_in_wall_time_while_the_simulator_hangs_and_not_while_it_is_paused(
    panel: Tuple[MapPanel, System], monkeypatch: pytest.MonkeyPatch
) -> None:
    made, system = panel
    now = [100.0]
    monkeypatch.setattr(system, "wall", lambda: now[0])
    transform = TransformStamped(child_frame_id="base_footprint")
    transform.header.frame_id, transform.transform.rotation.w = "map", 1.0

    def moves(at: float) -> None:
        transform.header.stamp = rospy.Time(at)
        system.buffer.set_transform(transform, "")

    moves(1.0)
    made.sample()
    assert made.source().connected
    now[0] += 3600.0  # the monitor hangs
    assert made.source().connected

    def stands() -> None:  # ROS time
        for _ in range(5):
            now[0] += OLD_POSITION / 4
            made.sample()
            system.silence_clock()

    stands()
    assert not made.source().connected
    moves(1.1)
    made.sample()
    assert made.source().connected
    made.state.tree.set("meta", "simulator", {"paused": True})
    for _ in range(5):
        now[0] += 1.0
        made.sample()
        assert made.source().connected
    made.state.tree.set("meta", "simulator", {"paused": False})
    stands()
    assert not made.source().connected


def test_a_panel_that_fails_does_not_end_the_pulse(monkeypatch: pytest.MonkeyPatch) -> None:
    said: List[str] = []
    monkeypatch.setattr(rospy, "logerr", said.append)
    again = threading.Event()

    class Failing(Panel):
        name, times = "plan", 0

        def sample(self) -> None:
            self.times += 1
            if self.times == 1:
                raise ValueError("strange")
            again.set()

    board = PanelBoard(MonitorModel(Inbox()), ros=System(), only=[Failing])
    board.start()
    try:
        assert again.wait(LONG)
        assert said == ["panel plan: ValueError: strange"]
    finally:
        board.stop()


def test_of_several_navigation_servers_the_one_that_is_gone_is_named(panel: Tuple[MapPanel, System]) -> None:
    made, system = panel
    name_robots(made, "ann", "bob")
    (own,) = [each for each in system.subscribers if each.topic == "move_base/result"]
    own.connections = 0
    system.subscribers.remove(own)  # no server without a name
    made.look({})
    system.look()
    ann, bob = "/ann/navigation", "/bob/navigation"
    assert made.owners() == {"navigation": Source(True, ann, (bob,))}
    (result,) = [each for each in system.of("bob") if each.topic.endswith("/result")]
    result.connections = 0
    assert made.owners() == {"navigation": Source(False, bob, (ann,))}


def test_requests_of_a_strange_panel_harm_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    said: List[str] = []
    monkeypatch.setattr(rospy, "logerr", said.append)

    class Failing(Panel):
        name = "plan"

        def requests(self) -> Dict[str, Request]:
            raise KeyError("strange")

    class Asked(Panel):
        name = "map"

        def requests(self) -> Dict[str, Request]:
            return {"ask": lambda fields, by: f"asked by {by}", "break": lambda fields, by: str(1 / 0)}

    board = PanelBoard(MonitorModel(Inbox()), ros=System(), only=[Failing, Asked])
    assert len(said) == 0
    robot = RobotRequests()
    robot.offered = board.requests
    assert robot.carry_out("ask", {}, "Ana") == {"done": "asked by Ana"}
    assert "panel plan: KeyError" in said[0]
    with pytest.raises(ControlError, match="division by zero"):
        robot.carry_out("break", {}, "Ana")


def test_a_panel_that_fails_blinds_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    said: List[str] = []
    monkeypatch.setattr(rospy, "logerr", said.append)
    called: List[str] = []

    class Other(Panel):
        name, place = "map", 9

        def look(self, topics: Dict[str, str]) -> None:
            called.append("look")

        def sample(self) -> None:
            called.append("sample")

        def check(self, at: float, wall: float) -> None:
            called.append("check")

    class Failing(Panel):
        name, place = "plan", 1

        def fail(self, *_: Any) -> Any:
            raise TypeError("strange")

        look = sample = check = source = owners = fail

    state = MonitorModel(DirectInbox())
    board = PanelBoard(state, ros=System(), only=[Failing, Other])
    monkeypatch.setattr(System, "look", lambda self: {})
    board.look()
    board.beat()
    assert called == ["look", "sample", "check"]
    assert state.checked_at > float("-inf"), "else the page says that the monitor hangs"
    assert set(said) == {"panel plan: TypeError: strange"}

# SPDX-License-Identifier: Apache-2.0
"""The nodes where ROS time is set: no wait gets longer or shorter, and old sensor data counts as such."""

import threading
from types import SimpleNamespace
from typing import Any, Callable, List
from unittest.mock import MagicMock

import numpy as np
import pytest
import rospy
from audio_common_msgs.msg import AudioData
from fakes.topics import Topics
from geometry_msgs.msg import TransformStamped
from merlin_msgs.msg import ListenGoal
from nav_msgs.msg import OccupancyGrid, Odometry
from sensor_msgs.msg import LaserScan

from merlin_reactive.listening import listen_node
from merlin_reactive.localization import localization_node
from merlin_reactive.localization.localization_node import LocalizationNode
from merlin_reactive.ros_clock import RosClock
from merlin_reactive.speech.speech_node import CHUNK, Speaker
from merlin_reactive.speech.speech_synthesizer import RATE, Sound
from merlin_ros import ros_alarm
from merlin_ros.health import ERROR

BACK, FORWARD = -50.0, 50.0


class Clock:
    """ROS time; it is set before the second wait ends. Of a simulated one what had just passed is lost then.

    :param step: s by which it is set.
    :ivar wall: whether it is the clock of the computer.
    :ivar passed: the monotonic clock, s.
    :ivar waits: s, of each.
    """

    def __init__(self, step: float, wall: bool) -> None:
        self._step, self.wall = step, wall
        self.now, self.passed = 100.0, 20.0
        self.waits: List[float] = []
        self.on_wait: Callable[[threading.Event], None] = lambda stop: None

    def wait(self, seconds: float, stop: threading.Event) -> bool:
        self.waits.append(seconds)
        self.go_on(seconds)
        if len(self.waits) == 2:
            self.now += self._step
        self.on_wait(stop)
        return not stop.is_set()

    def go_on(self, seconds: float) -> None:
        """So much passes."""
        self.now += seconds
        self.passed += seconds

    def wake(self) -> None:
        pass


@pytest.fixture(params=["simulated", "wall", "wall, set forward"])
def clock(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Clock:
    made = Clock(FORWARD if "forward" in request.param else BACK, "wall" in request.param)
    monkeypatch.setattr(rospy.rostime, "is_wallclock", lambda: made.wall)
    monkeypatch.setattr(ros_alarm, "time", SimpleNamespace(monotonic=lambda: made.passed))
    monkeypatch.setattr(rospy, "get_time", lambda: made.now)
    monkeypatch.setattr(rospy.Time, "now", lambda: rospy.Time.from_sec(made.now))
    monkeypatch.setattr(rospy, "get_param", lambda name, default=None: default)
    monkeypatch.setattr(rospy, "on_shutdown", lambda hook: None)
    return made


@pytest.fixture
def topics(monkeypatch: pytest.MonkeyPatch) -> Topics:
    return Topics(monkeypatch)


def test_a_wait_takes_its_time(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    ticked = MagicMock(wait=lambda _: clock.wait(1.0, threading.Event()))
    monkeypatch.setattr(rospy.rostime, "get_rostime_cond", lambda: ticked)
    assert RosClock().wait(9.5, threading.Event())
    assert len(clock.waits) == (10 if clock.wall else 11)


def test_a_sound_is_played_in_its_time(topics: Topics, clock: Clock) -> None:
    card: Any = SimpleNamespace(play=lambda sound: None, stop=lambda: None)
    speaker = Speaker(clock, card)  # type: ignore[arg-type]
    sound = Sound(np.zeros(round(5 * CHUNK * RATE), dtype=np.int16))
    assert speaker.play(sound, threading.Event(), lambda played: None) == pytest.approx(5 * CHUNK)
    assert len(clock.waits) == 5 and max(clock.waits) < 3 * CHUNK
    assert not clock.wall or clock.waits == pytest.approx([CHUNK] * 5)


def listener(monkeypatch: pytest.MonkeyPatch, clock: Any, recognizer: Any) -> Callable[[Any], None]:
    """What carries out the goals of a node ``listen``."""
    served: List[Any] = []

    def serve(name: str, kind: type, execute: Any, cancel: Any) -> Any:
        served.append(execute)
        return SimpleNamespace(shutdown=None, start=lambda: None)

    monkeypatch.setattr(listen_node, "available", lambda: True)
    monkeypatch.setattr(listen_node, "SpeechRecognizerProcess", lambda threshold: recognizer)
    monkeypatch.setattr(listen_node, "SerialActionServer", serve)
    monkeypatch.setattr(listen_node, "RosClock", lambda: clock)
    listen_node.ListenNode()
    return served[0]


def test_one_listens_no_longer_than_the_time_out(
    topics: Topics, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    def hear(stop: threading.Event) -> None:
        if len(clock.waits) < 4:  # noise
            clock.go_on(-clock.waits[-1] / 2.0)
            stop.set()

    listen = listener(monkeypatch, clock, SimpleNamespace(use=lambda grammar: None, close=None))
    clock.on_wait = hear
    ends: List[str] = []
    goal = SimpleNamespace(
        goal=ListenGoal(timeout=rospy.Duration(8.0)),
        feedback=lambda feedback: None,
        cancel_requested=False,
        succeed=lambda result, text: ends.append(text),
    )
    listen(goal)
    assert ends == ["no speech within 8.0 s"]
    assert clock.waits == ([8.0, 4.0, 2.0, 1.0] if clock.wall else [8.0, 4.0, 4.0, 2.0])


@pytest.mark.parametrize("comes", [True, False])
def test_a_sentence_is_broken_off_when_ros_time_and_running_time_have_passed(
    topics: Topics, clock: Clock, monkeypatch: pytest.MonkeyPatch, comes: bool
) -> None:
    """In fast simulated time, a busy machine delivers the sound late."""
    loud = np.full(RATE, 5000, dtype="<i2")
    heard: List[int] = []
    waited: List[float] = []

    def say(sound: np.ndarray) -> None:
        topics.send("/audio/microphone", AudioData(data=sound.tobytes()))

    def deadline(seconds: float) -> Any:
        def wait_event(event: threading.Event) -> None:
            waited.append(seconds)
            if comes:
                say(np.concatenate([loud, np.zeros(RATE, dtype="<i2")]))

        return SimpleNamespace(wait_event=wait_event)

    def understand(utterance: np.ndarray) -> Any:
        heard.append(len(utterance))
        return SimpleNamespace(text="tea", confidence=1.0)

    monkeypatch.setattr(listen_node, "Deadline", deadline)
    recognizer = SimpleNamespace(use=lambda grammar: None, close=None, understand=understand)
    listen = listener(monkeypatch, clock, recognizer)
    clock.on_wait = lambda stop: say(loud) if len(clock.waits) == 1 else None
    goal = MagicMock(goal=ListenGoal(timeout=rospy.Duration(8.0)), cancel_requested=False)
    listen(goal)
    assert waited == [listen_node.BROKEN_OFF] == clock.waits[1:]
    assert (heard[0] > 2 * RATE) == comes


def test_a_scan_of_before_is_no_new_one(
    topics: Topics, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    mount = TransformStamped()
    mount.transform.rotation.w = 1.0
    buffer = SimpleNamespace(lookup_transform=lambda *_: mount)
    tf = SimpleNamespace(Buffer=lambda: buffer, TransformListener=lambda buffer: None)
    monkeypatch.setattr(localization_node, "tf2_ros", tf)
    monkeypatch.setattr(rospy, "Service", lambda *_: None)
    node = LocalizationNode()
    room = OccupancyGrid(data=[0] * 400)
    room.info.width = room.info.height = 20
    room.info.resolution = 0.5
    topics.send("/map", room)
    odometry, scan = Odometry(), LaserScan(ranges=[1.0, 1.0, 1.0], angle_increment=0.5, range_max=10.0)
    odometry.header.stamp = scan.header.stamp = rospy.Time.from_sec(clock.now)
    odometry.pose.pose.orientation.w = 1.0
    topics.send("/odom", odometry)
    topics.send("/scan", scan)
    assert node.health().level != ERROR
    clock.now += BACK
    assert node.health().level == ERROR and "no scan" in node.health().message

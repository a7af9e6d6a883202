# SPDX-License-Identifier: Apache-2.0
"""What a monitor tells the guards of its robots, when it was restarted while a stop stands."""

from typing import Any, Callable, Dict, List, Tuple

import pytest
import rospy
from merlin_msgs.msg import GuardStatus

from merlin_monitor.web import robot_guards
from merlin_monitor.web.robot_guards import FRESH, START, RobotGuards


class Robots:
    """Guards of robots as topics: what they say goes in, what they are told comes out."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.reported: List[Tuple[str, str]] = []
        self.now = 1000.0
        self._listeners: Dict[str, Any] = {}
        self._later: List[Callable[[], object]] = []
        monkeypatch.setattr(rospy, "Publisher", self._publisher)
        monkeypatch.setattr(rospy, "Subscriber", self._subscriber)
        monkeypatch.setattr(robot_guards, "ServiceProxy", lambda *_, **__: self)
        monkeypatch.setattr(robot_guards, "time", self)
        monkeypatch.setattr(robot_guards, "call_later", self._call_later, raising=False)

    def monotonic(self) -> float:
        return self.now

    def _publisher(self, topic: str, *_: Any, **__: Any) -> Any:
        return _Reported(self.reported, topic.partition("/")[0])

    def _subscriber(self, topic: str, _: Any, listener: Any, **__: Any) -> None:
        self._listeners[topic.partition("/")[0]] = listener

    def _call_later(self, seconds: float, call: Callable[[], object]) -> None:
        self._later.append(call)

    def read_on(self) -> None:
        """The monitor's process goes on for so long that it has read what was said before."""
        while self._later:
            self._later.pop(0)()

    def take_later(self) -> Callable[[], object]:
        """What the monitor does once it has read on."""
        return self._later.pop()

    def available(self) -> bool:
        """None of their services is there."""
        return False

    def name(self) -> str:
        return "merlin/release"

    def monitor(self, *robots: str) -> RobotGuards:
        """A monitor begins, and finds robots."""
        made = RobotGuards()
        for robot in robots:
            made.follow(robot, True)
        return made

    def say(self, robot: str, stopped_by: str = "") -> None:
        """A guard publishes its status."""
        state = GuardStatus.STOPPED if stopped_by else GuardStatus.IDLE
        reason = f"stopped by {stopped_by}" if stopped_by else ""
        self._listeners[robot](GuardStatus(state=state, reason=reason))


class _Reported:
    def __init__(self, reported: List[Tuple[str, str]], robot: str) -> None:
        self._reported, self._robot = reported, robot

    def publish(self, by: Any) -> None:
        self._reported.append((self._robot, by.data))


@pytest.fixture
def robots(monkeypatch: pytest.MonkeyPatch) -> Robots:
    return Robots(monkeypatch)


def test_a_restarted_monitor_holds_who_joins_while_a_stop_stands(robots: Robots) -> None:
    monitor = robots.monitor("ria")
    robots.say("ria", stopped_by="Ana")
    assert monitor.stop_stands and robots.reported == []
    robots.now += 3600.0
    monitor.follow("tom", True)
    robots.say("tom")
    assert robots.reported == [("tom", "Ana")]


@pytest.mark.parametrize("by", ["/rosservice_12", "an unknown node", "button 3 of /joy"])
def test_the_stop_of_one_robot_is_no_stop_of_all(robots: Robots, by: str) -> None:
    monitor = robots.monitor("ria", "tom")
    robots.say("ria", stopped_by=by)
    robots.say("tom")
    assert not monitor.stop_stands and robots.reported == []


def test_a_robot_that_comes_held_stops_no_other_later(robots: Robots) -> None:
    monitor = robots.monitor("ria", "tom")
    robots.say("ria")
    robots.now += START
    robots.say("tom", stopped_by="Ana")
    robots.say("ria")
    assert not monitor.stop_stands and robots.reported == []


def test_what_was_released_is_not_taken_up(robots: Robots) -> None:
    monitor = robots.monitor("ria", "tom")
    robots.say("ria", stopped_by="Ana")
    monitor.release()
    robots.say("tom", stopped_by="Ana")
    assert not monitor.stop_stands


def test_a_stop_is_sent_though_the_release_of_the_one_before_is_heard_behind_it(robots: Robots) -> None:
    monitor = robots.monitor()
    robots.say("merlin", stopped_by="Ana")
    monitor.stop("Bob")  # elsewhere the base has just been released
    assert robots.reported == [("merlin", "Bob")] and monitor.wait_held(0.0) == {"": False}
    robots.say("merlin")
    robots.say("merlin", stopped_by="Bob")
    assert monitor.wait_held(0.0) == {"": True} and monitor.stop_stands


def test_a_guard_that_goes_on_holding_its_base_confirms_a_further_stop(robots: Robots) -> None:
    monitor = robots.monitor()
    robots.say("merlin", stopped_by="Ana")
    monitor.stop("Bob")
    robots.read_on()
    robots.say("merlin", stopped_by="Ana")
    assert monitor.wait_held(0.0) == {"": True}


@pytest.mark.parametrize("holder", ["Ana", "Bob"])
def test_what_a_guard_has_said_before_confirms_no_stop(robots: Robots, holder: str) -> None:
    monitor = robots.monitor()
    robots.say("merlin", stopped_by=holder)
    monitor.stop("Bob")
    robots.say("merlin", stopped_by=holder)  # before it was released elsewhere
    robots.say("merlin")
    assert monitor.wait_held(0.0) == {"": False} and monitor.stop_stands
    robots.say("merlin", stopped_by="Bob")
    assert monitor.wait_held(0.0) == {"": True} and monitor.stop_stands
    robots.read_on()
    robots.say("merlin")
    assert not monitor.stop_stands, "it was released elsewhere"


def test_only_the_last_stop_says_what_was_read_before_it(robots: Robots) -> None:
    monitor = robots.monitor()
    robots.say("merlin", stopped_by="Ana")
    monitor.stop("Bob")
    first = robots.take_later()
    monitor.stop("Bob")
    first()
    robots.say("merlin", stopped_by="Ana")
    assert monitor.wait_held(0.0) == {"": False}


def test_who_holds_now_is_what_a_guard_says_that_still_speaks(robots: Robots) -> None:
    monitor = robots.monitor()
    assert monitor.holders_now() == ""
    robots.say("merlin", stopped_by="Ana")
    assert monitor.holders_now().startswith("the base is held by Ana")
    robots.now += FRESH + 0.1
    assert monitor.holders_now() == "" and monitor.holders_but("Bob")

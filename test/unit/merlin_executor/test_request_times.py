# SPDX-License-Identifier: Apache-2.0
"""The times that a client gives: as ROS times, as seconds from now, and as a person writes them."""

import math
import threading
import time
from types import SimpleNamespace
from typing import Any, List

import pytest
import rospy

from merlin_executor import executor_client, request_times
from merlin_executor.executor_client import MerlinExecutorClient
from merlin_executor.request_times import at_time, read_time, ros_time, with_ros_times
from merlin_test import LONG

NOON = time.mktime((2026, 11, 26, 12, 0, 0, 0, 0, -1))


@pytest.fixture
def now(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    clock = SimpleNamespace(at=NOON)
    monkeypatch.setattr(rospy, "get_time", lambda: clock.at)
    return clock


def test_seconds_count_from_now_and_ros_times_are_kept(now: SimpleNamespace) -> None:
    assert ros_time(90, "deadline").to_sec() == NOON + 90.0
    assert ros_time(rospy.Time(7), "deadline") == rospy.Time(7)
    assert ros_time(None, "deadline") == rospy.Time()


def test_before_the_first_word_of_a_simulators_clock_no_time_is_counted(
    now: SimpleNamespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    now.at = 0.0
    with monkeypatch.context() as at_once, pytest.raises(ValueError, match="deadline: .* clock stands"):
        at_once.setattr(request_times, "CLOCK_WAIT", 0.0)
        ros_time(90, "deadline")
    monkeypatch.setattr(request_times, "CLOCK_WAIT", LONG)
    clock = rospy.rostime.get_rostime_cond()

    def begin() -> None:
        with clock:
            now.at = 1231.0
            clock.notify_all()

    threading.Thread(target=begin, name="clock").start()
    assert ros_time(90, "deadline").to_sec() == 1321.0


@pytest.mark.parametrize("wrong", [math.nan, math.inf, 0.0, -5.0, True, "10min", 1e12, rospy.Time(2**32)])
def test_what_is_not_a_time_is_refused_by_its_name(now: SimpleNamespace, wrong: Any) -> None:
    with pytest.raises(ValueError, match="^not_before is "):
        ros_time(wrong, "not_before")


def test_a_time_from_now_stays_the_same_when_it_is_sent_again(now: SimpleNamespace) -> None:
    fixed = with_ros_times({"priority": 3, "deadline": 60.0, "not_before": None})
    now.at += 30.0
    assert with_ros_times(fixed)["deadline"].to_sec() == NOON + 60.0
    assert fixed["priority"] == 3


@pytest.mark.parametrize(
    ("text", "seconds"),
    [("90s", 90), ("10min", 600), ("1.5h", 5400), ("14:30", 9000), ("12:00:05", 5), ("9min", 540)],
)
def test_what_a_person_writes(now: SimpleNamespace, text: str, seconds: float) -> None:
    at = at_time(read_time(text), "--deadline")
    assert at is not None and at.to_sec() == NOON + seconds


@pytest.mark.parametrize("text", ["10", "soon", "25:00", "14:60", "-5min", "10 min", "", "1e3s"])
def test_other_words_are_refused_with_what_to_write(text: str) -> None:
    with pytest.raises(ValueError, match="is not a time; write 90s, 10min or 2h from now, or 14:30 of today"):
        read_time(text)


def test_a_time_beyond_a_year_is_refused() -> None:
    with pytest.raises(ValueError, match="'9000h' is too long"):
        read_time("9000h")


def test_a_time_of_the_day_that_has_passed_is_refused(now: SimpleNamespace) -> None:
    with pytest.raises(ValueError, match="--deadline: 09:00:00 has passed today; write a time from now"):
        at_time(read_time("9:00"), "--deadline")


def test_a_simulation_has_no_time_of_the_day(now: SimpleNamespace) -> None:
    now.at = 12.0
    with pytest.raises(ValueError, match="the robot's clock is a simulator's"):
        at_time(read_time("14:30"), "--deadline")
    at = at_time(read_time("10s"), "--deadline")
    assert at is not None and at.to_sec() == 22.0


def test_the_client_sends_the_times(now: SimpleNamespace, monkeypatch: pytest.MonkeyPatch) -> None:
    sent: List[Any] = []
    reported: List[Any] = []
    monkeypatch.setattr(executor_client, "ActionClient", lambda *_: SimpleNamespace())
    client = MerlinExecutorClient(knowledge_base=None, on_send=reported.append)
    with pytest.raises(ValueError, match="deadline is nan"):
        client.send("(checked hall)", deadline=math.nan)
    assert not reported, "what is refused is not reported as sent"
    monkeypatch.setattr(executor_client, "ExecutorRequest", Sent(sent))
    client.send("(checked hall)", deadline=60.0, not_before=rospy.Time(7))
    client.send("(checked hall)")
    times = [(goal.not_before.to_sec(), goal.deadline.to_sec()) for goal in sent]
    assert times == [(7.0, NOON + 60.0), (0.0, 0.0)]


class Sent:
    """Keeps the goals that are sent."""

    def __init__(self, goals: List[Any]) -> None:
        self._goals = goals
        self.done = False

    def __call__(self, client: Any, goal: Any, *more: Any) -> "Sent":
        self._goals.append(goal)
        return self

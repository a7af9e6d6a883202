# SPDX-License-Identifier: Apache-2.0
"""Cancels before their goals, or of all up to a stamp while the clock jumps back; floods; equal ids."""

from types import SimpleNamespace
from typing import Any, Callable, Dict, Iterator, List

import pytest
import rospy
from actionlib_msgs.msg import GoalID, GoalStatus
from fakes.topics import Topics
from merlin_msgs.msg import ListenAction, ListenActionGoal

from merlin_ros.actions import action_server
from merlin_ros.actions.action_server import (
    BURST,
    BURST_TIME,
    EARLY_CANCELS,
    ENDED,
    ActionServer,
    ServerGoal,
)
from merlin_ros.actions.lease import LASTING
from merlin_ros.alarms import Alarm
from merlin_test import LONG


class Served:
    """A server, the goals that it was given, and its client."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *left: str) -> None:
        self.goals: List[ServerGoal] = []
        self.on_cancel: Callable[[ServerGoal], None] = lambda goal: None
        self._topics = Topics(monkeypatch)
        self.server = ActionServer(
            "listen", ListenAction, self.goals.append, lambda goal: self.on_cancel(goal)
        )
        self.server.start([(ListenActionGoal(goal_id=GoalID(id=name)), "/dead") for name in left])

    def send(self, name: str, stamp: float, client: str = "/other") -> None:
        goal_id = GoalID(id=name, stamp=rospy.Time(stamp))
        self._topics.send("/listen/goal", ListenActionGoal(goal_id=goal_id), {"callerid": client})

    def cancel(self, name: str = "", stamp: float = 0) -> None:
        self._topics.send("/listen/cancel", GoalID(id=name, stamp=rospy.Time(stamp)))

    @property
    def names(self) -> List[str]:
        """The ids of its goals."""
        return [goal.id for goal in self.goals]

    def lists(self) -> List[List[int]]:
        """The present states of the goals in each status list since the last look."""
        statuses, found = self._topics.published("/listen/status"), []
        while not statuses.empty():
            found.append([status.status for status in statuses.get_nowait().status_list])
        return found

    def status(self) -> Dict[str, str]:
        """The text of each goal in the last status list."""
        statuses = self._topics.published("/listen/status")
        last = statuses.get(timeout=LONG)
        while not statuses.empty():
            last = statuses.get_nowait()
        return {status.goal_id.id: status.text for status in last.status_list}


@pytest.fixture
def served(monkeypatch: pytest.MonkeyPatch, clock: Any) -> Iterator[Served]:
    monkeypatch.setattr(rospy, "logerr", lambda *_: None)
    made = Served(monkeypatch)
    yield made
    made.server.shutdown()


def test_who_looks_for_a_goal_and_cancels_it_hears_from_its_owner(served: Served) -> None:
    served.cancel(f"one{LASTING}")  # on its own connection, and first
    served.send(f"one{LASTING}", 1)
    (goal,) = served.goals
    assert goal.cancel_requested and not goal.done
    assert goal.reject(text="nothing of this id runs")


def test_many_changes_at_once_are_few_status_lists(served: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    alarms: List[Alarm] = []

    def call_later(seconds: float, call: Callable[[], None]) -> Alarm:
        assert 0.0 < seconds <= BURST_TIME
        alarms.append(Alarm(call))
        return alarms[-1]

    now = SimpleNamespace(monotonic=lambda: 1e9)
    monkeypatch.setattr(action_server, "time", now)
    monkeypatch.setattr(action_server, "call_later", call_later)
    served.send("first", 1)
    served.goals[0].accept()
    assert [len(each) for each in served.lists()] == [1, 1]
    for number in range(50):
        served.send(str(number), 2)
    assert len(served.lists()) == BURST - 2
    (alarm,) = alarms
    alarm.ring()
    assert served.lists() == [[GoalStatus.ACTIVE, *[GoalStatus.PENDING] * 50]]
    now.monotonic = lambda: 1e9 + 1.0
    served.goals[0].succeed()
    assert served.lists() == [[GoalStatus.SUCCEEDED, *[GoalStatus.PENDING] * 50]]


def test_goals_up_to_the_stamp_are_cancelled(served: Served) -> None:
    served.cancel(stamp=100)
    served.send("late", 99)  # "new" is of a node to which the tick of the clock came first
    served.send("new", 101)
    assert served.names == ["new"]


def test_goals_are_taken_after_the_clock_has_jumped_back(served: Served, clock: Any) -> None:
    served.cancel(stamp=100)
    clock.set(3.0)
    served.send("new", 3)
    clock.set(120.0)
    served.send("later", 50)
    assert served.names == ["new", "later"]


def test_a_cancel_that_is_stamped_ahead_counts_as_now(served: Served, clock: Any) -> None:
    served.send("running", 100)
    served.cancel(stamp=86_500)
    assert served.goals[0].cancel_requested
    for now in (100.02, 200.0):
        clock.set(now)
        served.send(f"of {now}", int(now) + 1)
    assert served.names == ["running", "of 100.02", "of 200.0"]


def test_a_clock_that_is_set_back_after_a_cancel_refuses_no_goal(served: Served, clock: Any) -> None:
    served.cancel(stamp=100)
    clock.set(110.0)
    served.cancel("another")  # it looks at the clock
    clock.set(90.0)
    served.send("new", 90)
    served.cancel(stamp=90)
    clock.set(91.0)
    served.send("late", 89)
    assert served.names == ["new"] and served.goals[0].cancel_requested


def test_a_goal_that_is_stamped_ahead_can_be_cancelled_by_a_stamp(served: Served, clock: Any) -> None:
    served.send("ahead", 86_500)
    clock.set(101.0)
    served.cancel(stamp=101)
    assert served.goals[0].cancel_requested


def test_cancels_that_come_before_their_goals_do_not_grow_for_ever(served: Served) -> None:
    for number in range(EARLY_CANCELS + 2):
        served.cancel(str(number))
        served.cancel("0")  # once more: it is the youngest again
    for name in ("0", "2", "3"):
        served.send(name, 1)
    assert served.names == ["2"]


def test_the_status_list_of_a_flood_of_goals_names_the_last_ones(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(action_server, "KEEP_ENDED", 3600.0)  # a slow process ends the first ones long before
    for number in range(ENDED + 20):
        served.send(str(number), 1)
        if number != 3:
            served.goals[-1].reject()
    named = served.status()
    while "19" in named or str(ENDED + 19) not in named:  # the last ones come behind the burst
        named = served.status()
    assert len(named) == ENDED + 1
    assert "3" in named and "19" not in named and "20" in named


def test_what_raises_in_a_cancel_has_not_stopped_the_goal(served: Served) -> None:
    tried: List[str] = []

    def cancel(goal: ServerGoal) -> None:
        tried.append(goal.id)
        if len(tried) < 3:
            raise RuntimeError("can't start new thread")

    served.on_cancel = cancel
    served.send("drive", 100)
    for _ in range(4):
        served.cancel("drive")
        (goal,) = served.goals
        assert goal.cancel_requested and not goal.done
        if len(tried) < 3:
            assert served.status()["drive"] == "it is not stopped: RuntimeError: can't start new thread"
    assert len(tried) == 3, "what has stopped it is not called again"


def test_a_goal_with_the_id_of_another_clients_goal_is_left_out_and_named(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: List[str] = []
    monkeypatch.setattr(rospy, "logwarn", said.append)
    served.send("1", 100, "/robot1/mission")
    served.send("1", 101, "/robot1/mission")
    assert not said
    served.send("1", 102, "/robot2/mission")
    assert served.names == ["1"]
    (text,) = said
    assert "a goal of /robot2/mission is left out: its id 1 is that of a goal of /robot1/mission" in text


@pytest.fixture
def taken_up(monkeypatch: pytest.MonkeyPatch, clock: Any) -> Iterator[Served]:
    made = Served(monkeypatch, f"1{LASTING}", f"2{LASTING}")
    yield made
    made.server.shutdown()


def test_a_goal_of_an_earlier_life_is_taken_up_and_followed_by_who_sends_it_again(
    taken_up: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: List[str] = []
    monkeypatch.setattr(rospy, "logwarn", said.append)
    first, second = f"1{LASTING}", f"2{LASTING}"
    taken_up.send(first, 100, "/other")
    assert taken_up.names == [first, second] and not said
    taken_up.cancel(first)
    assert taken_up.goals[0].cancel_requested and set(taken_up.status()) == {first, second}
    taken_up.goals[0].cancelled()
    taken_up.send(first, 101, "/other")  # it has ended: whoever wants it again sends a new one
    assert taken_up.names == [first, second, first] and not taken_up.goals[2].done

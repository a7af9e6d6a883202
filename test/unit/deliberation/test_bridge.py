# SPDX-License-Identifier: Apache-2.0
"""The bridge: sensed facts before the answer, cancels, one action at a time. Without pyrobosim and master."""

import threading
from typing import Any, Dict, Iterator, List, Set, Tuple
from unittest.mock import MagicMock

import pytest
import rospy
from actionlib_msgs.msg import GoalID, GoalStatus
from fakes.topics import Topics
from small_house import HOUSE, state

from deliberation import bridge as module
from deliberation.bridge import SERVERS, Bridge
from merlin_planning.knowledge_client import ADD, KnowledgeError, Update
from merlin_test import LONG


class Bench:
    """A simulation that does what a test says, a knowledge base, and the topics of the bridge."""

    house = HOUSE

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.name = "/kb"
        self.true = state(site="desk", room="study")
        self.answer: Tuple[str, List[str]] = ("", [])
        self.may_end, self.begun = threading.Event(), threading.Event()
        self.may_end.set()
        self.stops = 0
        self.known: Set[Tuple[str, ...]] = set()
        self.refuses = False
        monkeypatch.setattr(module, "ServiceProxy", lambda *_, **__: MagicMock())
        self.points: Dict[str, Any] = {}
        monkeypatch.setattr(module, "set_param", lambda name, value: self.points.update(value))
        self.topics = Topics(monkeypatch)
        self.bridge = Bridge(self, self)  # type: ignore[arg-type]
        self.bridge.start()

    # --- the simulation

    def state(self) -> Any:
        return self.true

    def act(self, action: str, target: str) -> Tuple[str, List[str]]:
        self.begun.set()
        assert self.may_end.wait(LONG)
        return self.answer

    def stop(self) -> None:
        self.stops += 1
        if self.stops > 1:  # the first one came too early, as when a path is still planned
            self.answer = ("stopped", [])
            self.may_end.set()

    def end(self) -> None: ...

    # --- the knowledge base

    def update(self, steps: List[Update]) -> None:
        if self.refuses:
            raise KnowledgeError("/kb refused it")
        for kind, item in steps:
            fact = (item.attribute_name, *[each.value for each in item.values])
            (self.known.add if kind == ADD else self.known.discard)(fact)

    # --- clients

    def send(self, action: str, target: str, name: str = "g") -> None:
        server, kind = SERVERS[action]
        message = type(kind().action_goal)(goal_id=GoalID(id=name, stamp=rospy.Time(1)))
        if action == "navigate":
            position = message.goal.target_pose.pose.position
            point = self.points.get(target, {"x": 99.0, "y": 0.0})
            position.x, position.y = point["x"], point["y"]
        elif action == "detect":
            message.goal.classes = [target]
        else:
            message.goal.object = target
        self.topics.send(f"/{server}/goal", message)

    def result(self, action: str) -> Any:
        return self.topics.published(f"/{SERVERS[action][0]}/result").get(timeout=LONG)


@pytest.fixture
def bench(clock: Any, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    made = Bench(monkeypatch)
    yield made
    made.may_end.set()
    made.bridge.shutdown()


def test_what_was_seen_is_known_before_the_action_is_answered(bench: Bench) -> None:
    bench.answer = ("", ["mug"])
    known: List[bool] = []

    def look(topic: str, _: Any) -> None:
        if topic.endswith("/result"):
            known.append(("is_at", "mug", "desk") in bench.known)

    bench.topics.before = look
    bench.send("detect", "mug")
    assert bench.result("detect").status.status == GoalStatus.SUCCEEDED
    assert known == [True]


def test_a_look_that_does_not_find_the_wanted_thing_is_remembered(bench: Bench) -> None:
    assert ("maybe_at", "soap", "desk") in bench.known
    bench.answer = ("", ["mug"])
    bench.send("detect", "soap")
    result = bench.result("detect")
    assert (result.status.status, list(result.result.names)) == (GoalStatus.SUCCEEDED, ["mug"])
    assert ("maybe_at", "soap", "desk") not in bench.known and ("is_at", "mug", "desk") in bench.known


def test_a_goal_that_is_no_site_is_refused(bench: Bench) -> None:
    bench.send("navigate", "nowhere")
    result = bench.result("navigate")
    assert result.status.status == GoalStatus.ABORTED
    assert result.status.text == "there is no site at (99.00, 0.00) m; drive to a point of interest"


def test_a_cancel_is_asked_for_until_the_drive_has_ended(bench: Bench) -> None:
    bench.may_end.clear()
    bench.send("navigate", "table")
    assert bench.begun.wait(LONG)
    bench.topics.send("/move_base/cancel", GoalID(id="g"))
    assert bench.result("navigate").status.status == GoalStatus.PREEMPTED
    assert bench.stops > 1


def test_a_second_action_is_refused_while_one_runs(bench: Bench) -> None:
    bench.may_end.clear()
    bench.send("navigate", "table")
    assert bench.begun.wait(LONG)
    bench.send("pick", "mug", "other")
    result = bench.result("pick")
    assert result.status.status == GoalStatus.ABORTED
    assert result.status.text == "the robot is at another action; cancel that first"


def test_an_action_whose_outcome_cannot_be_kept_fails_and_the_next_one_keeps_it(bench: Bench) -> None:
    bench.true = state(site="desk", room="study", holding="mug", things={"mug": "", "soap": "cabinet"})
    bench.refuses = True
    bench.send("pick", "mug")
    assert "could not be kept: /kb refused it" in bench.result("pick").status.text
    bench.refuses = False
    bench.send("navigate", "desk", "second")
    assert bench.result("navigate").status.status == GoalStatus.SUCCEEDED
    assert ("holding", "mug") in bench.known and ("hand_empty",) not in bench.known

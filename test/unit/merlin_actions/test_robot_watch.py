# SPDX-License-Identifier: Apache-2.0
"""What the knowledge says of robots, and who hears of them: one robot that is wrong hides no other one."""

import threading
from queue import Queue
from types import SimpleNamespace
from typing import Any, Callable, Dict, Iterator, List, Optional, Sequence, Tuple

import pytest
from diagnostic_msgs.msg import KeyValue
from fakes.topics import Topics
from merlin_msgs.msg import KnowledgeChanges, RobotHost
from rosplan_knowledge_msgs.msg import DomainFormula, KnowledgeItem

from merlin_actions import robot_watch
from merlin_actions.robot_watch import AvailableFacts, RobotWatch
from merlin_planning.knowledge_client import ADD, KnowledgeError, Update, fact
from merlin_planning.robot_roster import OF_ONE
from merlin_ros import alarms
from merlin_ros.alarms import Alarm
from merlin_ros.robot_values import AVAILABLE
from merlin_ros.service_proxy import ServiceUnavailable
from merlin_test import LONG

Announce = Callable[..., None]


class Knowledge:
    """A knowledge base that knows some robots, and others not."""

    name = "/kb"

    def __init__(self, *robots: str) -> None:
        self.changed = threading.Condition()
        self.available: Dict[str, bool] = dict.fromkeys(robots, True)
        self.silent = 0  # updates that it does not answer
        self.full = 0  # updates that it cannot store
        self.asked: List[str] = []  # robots of which something was to be written

    def predicates(self) -> Dict[str, DomainFormula]:
        return {AVAILABLE: DomainFormula(name=AVAILABLE, typed_parameters=[KeyValue("r", "robot")])}

    def propositions(self, predicate: str) -> List[Any]:
        return [fact(predicate, robot) for robot, there in self.available.items() if there]

    def instances(self, type_name: str) -> List[str]:
        assert type_name == "robot"
        return list(self.available)

    def update(self, updates: Sequence[Update]) -> None:
        (update,) = updates
        (robot,) = [value.value for value in update.item.values]
        with self.changed:
            self.asked.append(robot)
            if self.silent:
                self.silent -= 1
                raise ServiceUnavailable("it is being started again")
            if self.full:
                self.full -= 1
                raise KnowledgeError("the state file cannot be written")
            if robot not in self.available:
                raise KnowledgeError(f"unknown object '{robot}'")
            self.available[robot] = update.kind == ADD
            self.changed.notify_all()

    def wait(self, **expected: bool) -> bool:
        with self.changed:
            return self.changed.wait_for(lambda: expected.items() <= self.available.items(), LONG)


@pytest.fixture(autouse=True)
def announce(monkeypatch: pytest.MonkeyPatch) -> Iterator[Announce]:
    """Without ROS: a node announces the host of a robot to the watch of the test."""
    ends = threading.Event()
    read: List[Callable[[RobotHost], None]] = []

    def announced(robot: str, node: Optional[str] = None, sender: str = "/other") -> None:
        node = f"/{robot}/host" if node is None else node
        message = RobotHost(robot=robot, node=node, life="one")
        message._connection_header = {"callerid": sender}
        read[0](message)

    rospy = SimpleNamespace(
        is_shutdown=ends.is_set,
        Subscriber=lambda topic, _, callback, **__: read.append(callback),
        **dict.fromkeys(("loginfo", "logwarn", "logerr", "logwarn_throttle"), lambda *_: None),
    )
    monkeypatch.setattr(robot_watch, "rospy", rospy)
    monkeypatch.setattr(robot_watch, "RETRY", 0.01)
    looks: List[Alarm] = []

    def every(period: float, call: Callable[[], object]) -> Alarm:
        looks.append(alarms.every(period, call))
        return looks[-1]

    monkeypatch.setattr(robot_watch, "every", every)
    yield announced
    ends.set()
    for look in looks:  # else it finds the robots silent in a later test, and says so in its log
        look.cancel()


@pytest.fixture(autouse=True)
def others(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Another node changes the knowledge."""
    topics = Topics(monkeypatch)
    return lambda **change: topics.send("/kb/changes", KnowledgeChanges(client="/other", **change))


def instance(robot: str) -> KnowledgeItem:
    return KnowledgeItem(knowledge_type=KnowledgeItem.INSTANCE, instance_type="robot", instance_name=robot)


@pytest.mark.parametrize(
    "change",
    [{"cleared": True}, {"removed": [fact(AVAILABLE, "r1")]}, {"added": [instance("r1")]}],
    ids=["clear", "fact removed", "robot added"],
)
def test_a_robot_that_lives_is_available_again_after_others_have_dropped_that(
    others: Callable[..., None], change: Dict[str, Any]
) -> None:
    knowledge = Knowledge("r1", "r2")
    facts = AvailableFacts(knowledge)  # type: ignore[arg-type]
    for robot, available in (("r1", True), ("r2", False)):
        facts.put(robot, available)
        facts.wait_published(robot, LONG)
    knowledge.available["r1"] = False
    others(**change)
    assert knowledge.wait(r1=True, r2=False)


def test_a_robot_of_the_problem_that_is_loaded_again_is_not_available_before_it_is_heard(
    others: Callable[..., None],
) -> None:
    knowledge = Knowledge("r1")
    AvailableFacts(knowledge).settle()  # type: ignore[arg-type]
    assert knowledge.wait(r1=False)
    knowledge.available["r1"] = True
    others(cleared=True)
    assert knowledge.wait(r1=False)


def test_of_a_robot_that_is_removed_nothing_is_written_before_it_is_back(
    others: Callable[..., None],
) -> None:
    knowledge = Knowledge("r1", "r2")
    facts = AvailableFacts(knowledge)  # type: ignore[arg-type]
    for robot in ("r1", "r2"):
        facts.put(robot, True)
        facts.wait_published(robot, LONG)
    del knowledge.available["r1"]
    knowledge.available["r2"] = False
    others(removed=[instance("r1"), fact(AVAILABLE, "r1")])
    others(removed=[fact(AVAILABLE, "r2")])
    assert knowledge.wait(r2=True) and knowledge.asked == ["r1", "r2", "r2"]
    knowledge.available["r1"] = False
    others(added=[instance("r1")])
    assert knowledge.wait(r1=True)


@pytest.fixture
def retries(monkeypatch: pytest.MonkeyPatch) -> "Queue[Tuple[float, Alarm]]":
    """The calls that are to come, and after how many s: they come when the test rings them."""
    calls: Queue[Tuple[float, Alarm]] = Queue()

    def call_later(seconds: float, call: Callable[[], object]) -> Alarm:
        alarm = Alarm(call)
        calls.put((seconds, alarm))
        return alarm

    monkeypatch.setattr(robot_watch, "call_later", call_later)
    return calls


@pytest.mark.parametrize("change", [{"cleared": True}, {"added": [instance("ghost")]}], ids=["clear", "add"])
def test_a_robot_that_the_knowledge_does_not_know_hides_no_other_one(
    others: Callable[..., None], retries: "Queue[Tuple[float, Alarm]]", change: Dict[str, Any]
) -> None:
    knowledge = Knowledge("r1", "r2")
    facts = AvailableFacts(knowledge)  # type: ignore[arg-type]
    facts.put("ghost", True)
    facts.put("r1", False)
    assert knowledge.wait(r1=False)
    facts.put("r2", False)
    assert knowledge.wait(r2=False)
    assert knowledge.asked.count("ghost") == 1 and retries.empty(), "it comes with an event"
    knowledge.available["ghost"] = False  # it is added to the problem
    others(**change)
    assert knowledge.wait(ghost=True) and retries.empty()


def test_what_a_knowledge_base_cannot_store_is_written_after_growing_pauses(
    retries: "Queue[Tuple[float, Alarm]]",
) -> None:
    knowledge = Knowledge("r1", "r2")
    facts = AvailableFacts(knowledge)  # type: ignore[arg-type]
    pauses: List[float] = []
    for robot in ("r1", "r2"):
        knowledge.full = 3
        facts.put(robot, False)
        for _ in range(3):
            pause, alarm = retries.get(timeout=LONG)
            pauses.append(pause)
            alarm.ring()
        assert knowledge.wait(**{robot: False})
    first, second, third = pauses[:3]
    assert 0.0 < first < second < third and pauses[3:] == pauses[:3]


def test_robots_that_were_never_heard_are_reported_after_a_knowledge_base_was_silent() -> None:
    knowledge = Knowledge("r1", "r2")
    knowledge.silent = 1
    AvailableFacts(knowledge).settle()  # type: ignore[arg-type]
    assert knowledge.wait(r1=False, r2=False)


def test_a_fact_about_no_robot_keeps_no_other_one_from_being_written() -> None:
    knowledge = Knowledge("r1", "r2")
    robots = knowledge.propositions
    knowledge.propositions = lambda name: [fact(name), *robots(name)]  # type: ignore[method-assign]
    facts = AvailableFacts(knowledge)  # type: ignore[arg-type]
    facts.settle()
    assert knowledge.wait(r1=False, r2=False)


def test_a_listener_that_fails_hides_no_later_change(announce: Announce) -> None:
    watch = RobotWatch(Knowledge("r1", "r2"))  # type: ignore[arg-type]
    heard, both = [], threading.Event()

    def listen(change: Any) -> None:
        heard.append(change.robot)
        if len(heard) == 2:
            both.set()
        raise ValueError("this name is none for a topic")

    watch.listen(listen)
    for robot in ("r1", "r2"):
        announce(robot)
    assert both.wait(LONG), heard


def test_a_node_that_names_robots_without_end_hides_no_robot(
    announce: Announce, monkeypatch: pytest.MonkeyPatch
) -> None:
    reported: List[str] = []
    monkeypatch.setattr(robot_watch.rospy, "logwarn", reported.append)
    ghosts = [f"ghost{number}" for number in range(2000)]
    knowledge = Knowledge("r1", "r2", *ghosts)
    watch = RobotWatch(knowledge)  # type: ignore[arg-type]
    announce("r1", sender="/r1/host")
    for ghost in ghosts:
        announce(ghost, sender="/flood")
    announce("r2", sender="/r2/host")
    known = watch.why_not_each()
    assert len(known) < 100 and known["r1"] == known["r2"] == ""
    assert knowledge.wait(r1=True, r2=True)
    assert len([text for text in reported if "/flood names more than" in text]) == 1


def test_robots_that_come_and_go_for_ever_leave_nothing() -> None:
    knowledge = Knowledge("r1", *(f"guest{number}" for number in range(20)))
    facts = AvailableFacts(knowledge)  # type: ignore[arg-type]
    facts.put("r1", True)
    for number in range(20):
        for available in (True, False):
            facts.put(f"guest{number}", available)
            facts.wait_published(f"guest{number}", LONG)
    assert [robot for robot, there in knowledge.available.items() if there] == ["r1"]


def test_a_wait_for_the_knowledge_does_not_count_a_stall_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    knowledge = Knowledge("r1")
    knowledge.silent = 3
    facts = AvailableFacts(knowledge)  # type: ignore[arg-type]
    limit = 600.0
    clock = SimpleNamespace(now=0.0)

    def stalled() -> float:
        clock.now += limit  # between any two looks
        return float(clock.now)

    waits = lambda attempt, seconds: alarms.wait_ticks(attempt, seconds, stalled)  # noqa: E731
    monkeypatch.setattr(robot_watch, "wait_ticks", waits)
    facts.put("r1", False)
    facts.wait_published("r1", limit)
    assert not knowledge.available["r1"]


def test_a_robot_whose_host_is_gone_is_waited_for(announce: Announce) -> None:
    watch = RobotWatch(Knowledge("r1"))  # type: ignore[arg-type]
    never: Callable[[], bool] = lambda: False  # noqa: E731
    announce("r1")
    assert watch.wait("r1", 0.0, never) == ""
    watch.suspect("r1", "its process is gone")
    gone = "robot r1 is gone: its process is gone"
    assert watch.wait("r1", 0.1, never) == f"{gone}, and it did not come back within 0.1 s"
    assert watch.wait("r1", LONG, lambda: True) == gone
    waits, answers = threading.Event(), Queue()  # type: ignore[var-annotated]
    waiter = threading.Thread(target=lambda: answers.put(watch.wait("r1", LONG, waits.set)), daemon=True)
    waiter.start()
    assert waits.wait(LONG)
    announce("r1")
    assert answers.get(timeout=LONG) == ""


def test_a_robot_that_is_forgotten_is_reported_to_those_that_listen(
    announce: Announce, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = SimpleNamespace(monotonic=lambda: clock.now, sleep=lambda _: None, now=0.0)
    monkeypatch.setattr(robot_watch, "time", clock)
    guests = [f"guest{number}" for number in range(OF_ONE + 1)]
    watch = RobotWatch(Knowledge(*guests))  # type: ignore[arg-type]
    reported, heard = threading.Event(), []

    def listen(change: Any) -> None:
        heard.append((change.robot, change.forgotten))
        if change.forgotten:
            reported.set()

    watch.listen(listen)
    for guest in guests:
        clock.now += 60.0
        announce(guest, sender="/relay")
    assert reported.wait(LONG) and ("guest0", True) in heard
    assert "guest0" not in watch.why_not_each()


@pytest.mark.parametrize("node", ["", "host", "/two words/host", "//host", "/a\nb/host"])
def test_a_host_of_an_impossible_name_is_reported_and_no_robot(
    announce: Announce, monkeypatch: pytest.MonkeyPatch, node: str
) -> None:
    reported: List[str] = []
    monkeypatch.setattr(robot_watch.rospy, "logwarn_throttle", lambda _, text: reported.append(text))
    watch = RobotWatch(Knowledge("r1"))  # type: ignore[arg-type]
    announce("r1", node)
    assert watch.why_not_each() == {} and len(reported) == 1 and repr(node) in reported[0]

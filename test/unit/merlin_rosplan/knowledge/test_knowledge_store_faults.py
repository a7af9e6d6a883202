# SPDX-License-Identifier: Apache-2.0
"""A journal that fails, and threads that read and write at once."""

import threading
from types import SimpleNamespace

import pytest
import rospy
from knowledge_world import DOMAIN, add, texts

from merlin_pddl.formula import Comparison, Number
from merlin_pddl.knowledge import Fact, FunctionValue, Instance, StoredGoal
from merlin_pddl.problem_reader import parse_condition
from merlin_ros import ros_alarm
from merlin_ros.actions.lease import LeaseChange, LeaseState
from merlin_rosplan.knowledge.knowledge_checks import UpdateRefused
from merlin_rosplan.knowledge.knowledge_state import KnowledgeTables
from merlin_rosplan.knowledge.knowledge_store import LONG, Journal, JournalError, KnowledgeStore
from merlin_rosplan.messages.knowledge_messages import UpdateReader
from merlin_rosplan.nodes import goal_leases, knowledge_base
from merlin_test import LONG as LIMIT


class Disk(Journal):
    """A journal that can be full."""

    full = True

    def load(self):
        return 0, []

    def commit(self, steps, version):
        if self.full:
            raise OSError("no space left on device")


def test_journal_that_fails_takes_the_change_back(clock):
    store = KnowledgeStore(DOMAIN, clock=clock, journal=Disk())
    with pytest.raises(UpdateRefused, match="no space left"):
        add(store, Fact("idle", ()))
    assert store.facts() == [] and store.version == 0


def test_a_change_counts_and_is_heard_though_a_listener_fails(clock):
    def fail(change):
        raise ValueError("no message can say this")

    store, heard = KnowledgeStore(DOMAIN, clock=clock), []
    store.listen(fail)
    store.listen(lambda change: heard.append(change.version))
    add(store, Fact("idle", ()))
    assert texts(store.facts()) == ["(idle)"] and heard == [1]


def test_what_is_due_while_the_journal_fails_comes_true_afterwards(clock):
    disk = Disk()
    disk.full = False
    store = KnowledgeStore(DOMAIN, clock=clock, journal=disk)
    add(store, Fact("idle", ()), at=2_000)
    add(store, FunctionValue("limit", (), 1.0, op="increase"), at=2_000)
    clock.now, disk.full = 2_000, True
    for _ in range(2):
        with pytest.raises(JournalError, match="no space left"):
            store.fire_due()
        assert store.facts() == [] and store.next_due() == 2_000
    disk.full = False
    assert "(limit) has no value yet" in store.fire_due()[0]
    assert texts(store.facts()) == ["(idle)"] and store.next_due() is None


def test_timed_knowledge_outlives_a_full_disk(monkeypatch, clock):
    monkeypatch.setattr(knowledge_base, "RETRY", 0.01)
    monkeypatch.setattr(rospy, "logerr_throttle", lambda period, text: said.append(text))
    monkeypatch.setattr(rospy.rostime, "_rostime_initialized", True)
    rospy.rostime.switch_to_wallclock()
    disk, said, fired = Disk(), [], threading.Event()
    disk.full = False
    store = KnowledgeStore(DOMAIN, clock=clock, journal=disk)
    add(store, Fact("idle", ()), at=2_000)
    disk.full, clock.now = True, 2_000
    store.listen(lambda change: fired.set())
    watch = knowledge_base.TimedKnowledge(store, "/kb")
    try:
        while not said:
            assert not fired.wait(0.01)
        disk.full = False
        assert fired.wait(LIMIT)
    finally:
        watch.shutdown()
    assert texts(store.facts()) == ["(idle)"] and "no space left" in said[0]


def test_the_goals_of_a_client_that_dies_while_the_disk_is_full_go_afterwards(monkeypatch, clock):
    monkeypatch.setattr(goal_leases, "RETRY", 0.01)
    monkeypatch.setattr(rospy, "logerr_throttle", lambda period, text: said.set())
    disk, said, gone, changed = Disk(), threading.Event(), threading.Event(), []
    watch = SimpleNamespace(beside=lambda lease: [], shutdown=lambda: None)
    monkeypatch.setattr(
        goal_leases, "LeaseWatch", lambda topic, on_change: changed.append(on_change) or watch
    )
    disk.full = False
    store = KnowledgeStore(DOMAIN, clock=clock, journal=disk)
    with store.transaction("test") as change:
        for text in ("(idle)", "(not (idle))"):
            change.add_goal(StoredGoal(parse_condition(text, DOMAIN, store.objects())))
    leases = goal_leases.GoalLeases("/kb", store, UpdateReader(DOMAIN, store.objects, True))
    store.listen(lambda change: gone.set())
    disk.full = True
    changed[0](LeaseChange("a1 (idle)", LeaseState.LOST, "its client is gone"))
    assert said.is_set() and len(store.goals()) == 2
    disk.full = False
    assert gone.wait(LIMIT)
    assert len(store.goals()) == 1
    leases.shutdown()


def test_timed_knowledge_comes_soon_after_the_clock_was_set_forward(monkeypatch, clock):
    monkeypatch.setattr(ros_alarm, "LONGEST", 0.01)
    monkeypatch.setattr(rospy.rostime, "_rostime_initialized", True)
    rospy.rostime.switch_to_wallclock()
    looked, fired = threading.Event(), threading.Event()

    def now():
        time = clock.now / 1e9
        looked.set()
        return time

    monkeypatch.setattr(rospy, "get_time", now)
    store = KnowledgeStore(DOMAIN, clock=clock)
    hour = 3600 * 10**9
    add(store, Fact("idle", ()), at=hour)
    store.listen(lambda change: fired.set())
    watch = knowledge_base.TimedKnowledge(store, "/kb")
    try:
        assert looked.wait(LIMIT)
        clock.now = hour
        assert fired.wait(LIMIT)
    finally:
        watch.shutdown()
    assert texts(store.facts()) == ["(idle)"]


def test_readers_never_see_half_a_transaction(store):
    stop = threading.Event()
    halves = []

    def watch():
        while not stop.is_set():
            at_hall, at_kitchen = store.query([Fact("robot_at", ("hall",)), Fact("robot_at", ("kitchen",))])
            if at_hall == at_kitchen:
                halves.append((at_hall, at_kitchen))

    add(store, Fact("robot_at", ("hall",)))
    reader = threading.Thread(target=watch)
    reader.start()
    places = ["hall", "kitchen"]
    for _ in range(300):
        with store.transaction() as change:
            change.remove(Fact("robot_at", (places[0],)))
            change.add(Fact("robot_at", (places[1],)))
        places.reverse()
    stop.set()
    reader.join()
    assert halves == []


def test_nobody_waits_for_a_question_over_all_objects(store, monkeypatch):
    anywhere = parse_condition("(exists (?p - poi) (checked ?p))", store.domain, store.objects())
    searching, go_on = threading.Event(), threading.Event()
    objects = KnowledgeTables.objects

    def slow_objects(state, types):
        if threading.current_thread().name == "searcher":
            searching.set()
            assert go_on.wait(LIMIT)
        return objects(state, types)

    monkeypatch.setattr(KnowledgeTables, "objects", slow_objects)
    answers = []
    searcher = threading.Thread(
        target=lambda: answers.append(store.query([anywhere])), name="searcher", daemon=True
    )
    searcher.start()
    assert searching.wait(LIMIT)
    others = []

    def work():
        others.append(store.query([Fact("checked", ("kitchen",))]))
        add(store, Fact("checked", ("kitchen",)))
        others.append(store.query([anywhere]))

    other = threading.Thread(target=work, daemon=True)
    other.start()
    other.join(LIMIT)
    waited = other.is_alive()
    go_on.set()
    searcher.join(LIMIT)
    assert not waited and others == [[False], [True]]
    assert answers == [[False]], "the answer is of the moment of the question"


def test_long_lists_are_answered_like_short_ones(store):
    add(store, *[Instance("poi", f"p{number}") for number in range(LONG)])
    add(store, *[Fact("checked", (f"p{number}",)) for number in range(1, LONG, 2)])
    items = [Fact("checked", (f"p{number}",)) for number in range(LONG)]
    items += [
        Fact("checked", ("",)),
        Fact("checked", ("elsewhere",), negative=True),
        Instance("poi", "p7"),
        None,
    ]
    assert store.query(items) == [answer for item in items for answer in store.query([item])]


@pytest.mark.parametrize("value", [float("inf"), float("-inf"), float("nan")])
def test_a_goal_with_a_number_without_end_is_refused_and_can_be_named(value):
    goal = StoredGoal(Comparison(">", Number(value), Number(1.0)))
    store = KnowledgeStore(DOMAIN)
    with pytest.raises(UpdateRefused, match="not a finite number"), store.transaction() as transaction:
        transaction.add_goal(goal)
    with store.transaction() as transaction:
        transaction.remove_goal(goal)
    assert store.goals() == []

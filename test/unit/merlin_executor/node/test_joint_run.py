# SPDX-License-Identifier: Apache-2.0
"""Requests of one run end when their own goals hold, over a knowledge base of the test's."""

import threading
from types import SimpleNamespace
from typing import Any, Callable, FrozenSet, List, Optional, Set

import pytest
import rospy

from merlin_executor.core.outcome import Outcome, Verdict
from merlin_executor.node.joint_run import JointRun
from merlin_executor.node.own_goals import OwnGoals
from merlin_planning.knowledge_client import ADD_GOAL
from merlin_planning.knowledge_text import parse_goal, to_pddl
from merlin_ros.call_scope import current_scope
from merlin_ros.service_proxy import ServiceUnavailable
from merlin_test import LONG


class World:
    """A knowledge base, a dispatcher and a journal."""

    def __init__(self, tmp_path: Any) -> None:
        self.true: Set[str] = set()
        self.goals: List[str] = []
        self.literals: Optional[FrozenSet[str]] = frozenset()
        self.on_query: Callable[[], Any] = lambda: None
        self.owners: List[str] = []
        self.dispatcher = SimpleNamespace(steps_done=0, running=[], hand_over=self.owners.append)
        self.queries = 0
        self.ended: List[tuple] = []
        self.answered = threading.Semaphore(0)
        self.own = OwnGoals(self, str(tmp_path / "goals"))  # type: ignore[arg-type]

    def query(self, items: List[Any]) -> List[bool]:
        self.queries += 1
        self.on_query()
        return [to_pddl(item).lower() in self.true for item in items]

    def update(self, updates: List[Any]) -> None:
        for update in updates:
            text = to_pddl(update.item)
            if update.kind == ADD_GOAL:
                self.goals.append(text)
            else:
                self.goals.remove(text)

    def meanwhile(self) -> Optional[FrozenSet[str]]:
        return self.literals

    def achieved(self, requests: List[Any], verdict: Verdict) -> None:
        self.ended += [(request.name, verdict.outcome, sorted(self.goals)) for request in requests]
        for _ in requests:
            self.answered.release()

    def run(self, **goals: str) -> JointRun:
        course = SimpleNamespace()
        requests: List[Any] = [
            SimpleNamespace(
                name=name, items=parse_goal(text), course=course, stop=None, goal=SimpleNamespace(id=name)
            )
            for name, text in goals.items()
        ]
        system: Any = SimpleNamespace(
            knowledge=self, planning=None, dispatcher=self.dispatcher, recovery=self
        )
        engine: Any = SimpleNamespace(achieved=self.achieved)
        run = JointRun(requests, system, self.own, engine)
        self.own.add(run.items)
        return run

    def ends(self, run: JointRun) -> None:
        """An action of the plan ends."""
        self.dispatcher.steps_done += 1
        run.dispatch_changed()


@pytest.fixture
def world(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> World:
    monkeypatch.setattr(rospy, "logwarn", lambda *_: None)
    return World(tmp_path)


def looked(world: World) -> threading.Event:
    """Is set when the goals are asked the next time."""
    asked = threading.Event()
    world.on_query = asked.set
    return asked


def test_a_request_ends_when_its_goals_hold_and_leaves_those_that_another_one_needs(world: World) -> None:
    run = world.run(ann="(and (checked kitchen) (checked hall))", bob="(checked hall)", cem="(checked bath)")
    assert world.goals == ["(checked kitchen)", "(checked hall)", "(checked bath)"], "each once"
    world.true = {"(checked kitchen)"}
    world.ends(run)
    world.true = {"(checked kitchen)", "(checked hall)"}
    world.ends(run)
    assert world.answered.acquire(timeout=LONG) and world.answered.acquire(timeout=LONG)
    assert world.ended == [(name, Outcome.SUCCEEDED, ["(checked bath)"]) for name in ("ann", "bob")]
    assert [request.name for request in run.requests] == ["cem"]  # type: ignore[attr-defined]
    assert world.owners == ["cem"], "the dispatch is always on behalf of one that runs"


def test_what_another_one_needs_stays_a_goal(world: World) -> None:
    run = world.run(ann="(checked hall)", bob="(and (CHECKED hall) (checked bath))")
    world.true = {"(checked hall)"}
    world.ends(run)
    assert world.answered.acquire(timeout=LONG)
    assert world.ended[0] == ("ann", Outcome.SUCCEEDED, ["(CHECKED hall)", "(checked bath)"])


def test_the_goals_of_a_newcomer_stay_while_it_is_planned(world: World) -> None:
    run = world.run(ann="(checked hall)", bob="(checked bath)")
    newcomer: Any = SimpleNamespace(items=parse_goal("(checked attic)"))
    run.expect([newcomer])
    world.own.add(newcomer.items)
    world.true = {"(checked hall)"}
    run.look()
    assert world.ended == [("ann", Outcome.SUCCEEDED, ["(checked attic)", "(checked bath)"])]
    run.expect([])
    assert world.goals == ["(checked bath)"], "it does not join"


def test_what_holds_only_while_an_action_runs_does_not_hold(world: World) -> None:
    run = world.run(ann="(not (door_open hall))", bob="(checked bath)")
    world.true = {"(not (door_open hall))"}
    world.literals = frozenset(["(not (Door_open hall))"])
    asked = looked(world)
    world.ends(run)
    assert asked.wait(LONG)
    world.literals = frozenset()
    world.ends(run)
    assert world.answered.acquire(timeout=LONG)
    assert [name for name, *_ in world.ended] == ["ann"]


def test_goals_are_asked_again_when_an_action_begins_meanwhile(world: World) -> None:
    run = world.run(ann="(lit hall)", bob="(checked bath)")
    world.true = {"(lit hall)"}

    def begins() -> None:
        world.literals = frozenset(["(lit hall)"])

    world.on_query = begins
    run.look()
    assert world.ended == [] and world.queries == 2


def test_without_a_journal_goals_count_only_between_two_actions(world: World) -> None:
    run = world.run(ann="(checked hall)", bob="(checked bath)")
    world.true, world.literals = {"(checked hall)"}, None
    world.dispatcher.running = ["(drive)"]
    run.look()
    assert world.ended == []
    world.dispatcher.running = []
    run.look()
    assert [name for name, *_ in world.ended] == ["ann"]


def test_the_last_one_ends_with_the_run(world: World) -> None:
    run = world.run(ann="(checked hall)", bob="(checked bath)")
    world.true = {"(checked hall)", "(checked bath)"}
    world.ends(run)
    assert world.answered.acquire(timeout=LONG)
    assert [name for name, *_ in world.ended] == ["ann"]
    queries = world.queries
    world.ends(run)
    assert world.queries == queries and world.goals == ["(checked bath)"]


def test_with_one_request_nothing_is_asked(world: World) -> None:
    run = world.run(ann="(checked hall)")
    world.true = {"(checked hall)"}
    world.ends(run)
    assert world.queries == 0


def test_after_the_run_no_request_ends_by_it(world: World) -> None:
    run = world.run(ann="(checked hall)", bob="(checked bath)")
    world.true = {"(checked hall)"}
    world.on_query = run.close
    run.look()
    assert world.ended == []


def test_a_cancel_does_not_wait_for_a_look(world: World) -> None:
    run = world.run(ann="(checked hall)", bob="(checked bath)")
    hangs, ended = threading.Event(), threading.Event()

    def hang() -> None:
        given_up = threading.Event()
        with current_scope().calling(given_up.set):
            hangs.set()
            assert given_up.wait(LONG), "it was waited for"
        ended.set()
        raise ServiceUnavailable("does not answer")

    world.on_query = hang
    world.ends(run)
    assert hangs.wait(LONG)
    run.cancel()
    assert ended.wait(LONG)
    run.close()
    assert world.ended == []

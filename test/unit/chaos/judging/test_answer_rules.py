# SPDX-License-Identifier: Apache-2.0
"""What is judged of stops, of nodes at their ports, of the page and of several robots."""

from typing import Any, List

import pytest
from chaos.faults import AGAIN, HALF_OPEN, PAGE_STOP, SIGNAL, Fault
from chaos.judging import events
from chaos.judging.events import Event
from chaos.judging.evidence import NEXT, REQUEST, Evidence, settled
from chaos.judging.rules import Judgement, judge
from chaos.moments import Moment
from chaos.trials import Trial, Variant

POINTS = {"kitchen": (5.0, 0.0)}
KILL = Fault("navigation:kill", SIGNAL, ("navigation",), "KILL")
PAGE = Fault("page:stop", PAGE_STOP)
TWO = Variant(page=True, robots=("ann", "bob"))
HELD, FREE = 3, 1


class Scenario:
    """Events around a fault at 10 s."""

    def __init__(self, fault: Fault = KILL, **trial: Any) -> None:
        self._trial = Trial("test", fault, trial.pop("moment", Moment.IDLE), **trial)
        self._events = [Event(10.0, events.FAULT, {"fault": fault.name, "targets": []})]

    def add(self, at: float, kind: str, **data: Any) -> "Scenario":
        self._events.append(Event(at, kind, data))
        return self

    def drive(self, until: float, prefix: str = "") -> "Scenario":
        """0.3 m/s until a time, then standing."""
        for tick in range(160, 400):
            at = tick / 20
            speed = 0.3 if at < until else 0.0
            self.add(at, f"{prefix}{events.TRUTH}", speed=speed, turn=0.0, x=0.3 * min(at, until), y=0.0)
        return self

    def judge(self) -> Judgement:
        log = sorted(self._events, key=lambda event: event.at)
        log.append(Event(log[-1].at + 1.0, events.CLOSED))
        return judge(Evidence(self._trial, log, POINTS, []))

    def violations(self) -> List[str]:
        return list(self.judge().violations)


def test_a_stop_that_is_answered_and_released_is_good() -> None:
    scenario = Scenario().add(12.3, events.STOPPED, asked=12.0, ticks=0.3, error="")
    judgement = scenario.add(12.4, events.RELEASED, error="").judge()
    assert (judgement.violations, judgement.stopping) == ((), 0.3)


@pytest.mark.parametrize(
    ("ticks", "error", "words"),
    [(0.9, "", "only after 0.90 s"), (5.0, "no answer within 5 s", "is not answered: no answer")],
)
def test_a_stop_that_is_late_or_unanswered_is_seen(ticks: float, error: str, words: str) -> None:
    found = Scenario().add(12.0 + ticks, events.STOPPED, asked=12.0, ticks=ticks, error=error).violations()
    assert len(found) == 1 and words in found[0]


def test_a_stop_is_not_late_when_the_one_who_asked_did_not_run() -> None:
    assert Scenario().add(17.0, events.STOPPED, asked=12.0, ticks=0.2, error="").violations() == []


def test_a_base_that_is_not_released_is_seen() -> None:
    found = Scenario().add(22.0, events.RELEASED, error="never").violations()
    assert len(found) == 1 and "not released" in found[0]


def test_a_node_that_runs_and_does_not_answer_is_seen() -> None:
    scenario = Scenario().add(12.0, events.PROBED, node="listen", error="no answer")
    assert len(scenario.violations()) == 1 and "listen runs, and does not answer" in scenario.violations()[0]


def test_a_node_that_does_not_run_is_blamed_once() -> None:
    scenario = Scenario().add(12.0, events.PROBED, node="listen", error="no answer")
    found = scenario.add(13.0, events.MISSING, nodes=["listen"]).violations()
    assert len(found) == 1 and "does not run" in found[0]


@pytest.mark.parametrize(("status", "held", "blamed"), [(200, True, 0), (200, False, 1), (409, True, 1)])
def test_the_pages_word_is_compared_with_the_guard(status: int, held: bool, blamed: int) -> None:
    scenario = Scenario(PAGE, variant=Variant(page=True))
    scenario.add(10.1, events.GUARD, state=HELD if held else FREE, reason="", moving=False)
    scenario.add(10.2, events.PAGE, what="stop", status=status, words="Stopped and held", asked=10.0)
    assert len(scenario.violations()) == blamed


def test_a_stop_on_the_page_that_is_never_answered_is_seen() -> None:
    assert ["is not confirmed" in each for each in Scenario(PAGE).violations()] == [True]


def test_the_base_of_each_robot_has_to_stand_and_to_be_held() -> None:
    scenario = Scenario(PAGE, moment=Moment.DRIVING, variant=TWO).drive(10.3).drive(15.0, "bob/")
    scenario.add(10.1, events.GUARD, state=HELD, reason="", moving=False)
    scenario.add(10.1, f"bob/{events.GUARD}", state=FREE, reason="", moving=True)
    scenario.add(10.2, events.PAGE, what="stop", status=200, words="Stopped and held", asked=10.0)
    found = scenario.violations()
    assert len(found) == 2
    assert any("the base of bob stands only" in each for each in found)
    assert any("the guard of bob does not hold" in each for each in found)


def test_a_robot_whose_sensors_fall_silent_has_to_stand() -> None:
    fault = Fault("half_open:tf", HALF_OPEN, lasts=10.0, on="tf")
    assert Scenario(fault, moment=Moment.DRIVING).drive(11.4).violations() == []
    assert any(
        "stands only" in each for each in Scenario(fault, moment=Moment.DRIVING).drive(15.0).violations()
    )


@pytest.mark.parametrize(
    ("ends", "drove", "blamed"),
    [(21.9, 0.0, False), (22.9, 0.0, True), (24.9, 3.0, False), (25.9, 3.0, True)],
)
def test_what_dies_again_and_again_has_one_limit(ends: float, drove: float, blamed: bool) -> None:
    fault = Fault("again:planning_system", AGAIN, ("planning_system",), "KILL", 16.0, amount=4)
    scenario = Scenario(fault, moment=Moment.PLANNING).add(9.0, events.SENT, label=REQUEST, goals=[])
    for at in (11.0, 15.0, 18.0, 21.0):
        scenario.add(at, events.STATUS, state=1, stage="PLAN", request="r", running=[])
    if drove:
        scenario.add(12.0, events.GOALS, server="move_base", active=["a"], ended={})
        scenario.add(12.0 + drove, events.GOALS, server="move_base", active=[], ended={"a": 2})
    reason = "the planning system did not return"
    scenario.add(
        ends, events.ENDED, label=REQUEST, outcome="PLANNER_ERROR", reason=reason, action="", state=3
    )
    assert any("after the first kill" in each for each in scenario.violations()) == blamed


def test_a_reason_that_blames_a_client_that_there_is_not_is_seen() -> None:
    ended = {"outcome": "ACTION_FAILED", "reason": "move_base was recalled by another client"}
    scenario = Scenario().add(12.0, events.ENDED, label=REQUEST, action="", state=3, **ended)
    assert any("a client that there is not" in each for each in scenario.violations())


def test_a_next_goal_that_a_server_only_recalls_does_not_work() -> None:
    scenario = Scenario().add(12.0, events.NEXT).add(12.1, events.SENT, label=NEXT, goals=[])
    scenario.add(12.5, events.GOALS, server="move_base", active=[], ended={"b": 8})
    ended = {"outcome": "ACTION_FAILED", "reason": "the server refused it as older"}
    found = scenario.add(12.6, events.ENDED, label=NEXT, action="", state=4, **ended).violations()
    assert len(found) == 1 and "ended ACTION_FAILED before the base drove" in found[0]


def test_each_robot_has_one_place() -> None:
    facts = {"robot_at": ["(robot_at ann kitchen)", "(robot_at bob anywhere)"], "goals": [], "notes": []}
    assert settled(Event(0.0, events.FACTS, facts), ("ann", "bob"))
    assert not settled(Event(0.0, events.FACTS, facts))
    found = Scenario(variant=TWO).add(12.0, events.FACTS, **{**facts, "robot_at": facts["robot_at"][:1]})
    assert any("0 robot_at hold for bob" in each for each in found.violations())

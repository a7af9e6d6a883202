# SPDX-License-Identifier: Apache-2.0
"""A monitor that is started again in the middle of a plan knows what was done, and goes on with the run."""

from pathlib import Path
from typing import Any, Dict, List

import pytest
import rospy
from actionlib_msgs.msg import GoalID, GoalStatus
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from merlin_msgs.msg import (
    DispatchStatus,
    ExecuteActionResult,
    ExecuteResult,
    ExecutorStatus,
    MissionStatus,
)
from messages import Reported, changes, dispatch, executor, fact, feedback, running, value
from rosplan_dispatch_msgs.msg import CompletePlan

from merlin_monitor.state.history_store import HistoryStore
from merlin_monitor.state.inbox import DirectInbox
from merlin_monitor.state.knowledge_section import Contents
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_monitor.state.plan_steps import sequential_steps
from merlin_test import LONG

PLAN = CompletePlan([dispatch(number, "ask", ("p", place)) for number, place in enumerate("abcd")])
REQUEST = "/mission-1-12.5"


class Life:
    """A life of the monitor, with a clock that only this test moves."""

    def __init__(self, folder: Path, wall: float, session: str = "one", **options: Any) -> None:
        file = folder / "history.sqlite" if options.pop("kept", True) else None
        history = file and HistoryStore(file, 1000, clock=lambda: wall, session=session)
        self.state = MonitorModel(DirectInbox(), history)
        self.reported = Reported()
        self.state.on_event = self.reported
        self.state.start()

    def hears(self, at: float, done: int, first: bool = True) -> None:
        """What the topics keep for who comes late: the second or a later step runs."""
        status = DispatchStatus(
            state=DispatchStatus.RUNNING,
            plan_id=7,
            steps_done=done,
            steps_total=4,
            running=[running(done, "ask", ("p", "abcd"[done]))],
        )
        status.header.stamp = rospy.Time.from_sec(at)
        state = self.state
        state.now.mission(MissionStatus(mission="Round", state=MissionStatus.RUNNING, task=1), at)
        state.now.executor(executor(ExecutorStatus.RUNNING, request=REQUEST, goals=["(a)"]), at)
        if first:
            state.planned(*sequential_steps(PLAN), at)
        state.plan.dispatcher(status, at)

    @property
    def steps(self) -> List[Dict[str, Any]]:
        steps = self.state.tree.get("plan", "steps")
        return [steps[key] for key in sorted(steps)]

    @property
    def states(self) -> List[str]:
        return [step["state"] for step in self.steps]


def before(folder: Path) -> Life:
    """One step is done, the second runs."""
    life = Life(folder, 1000.0)
    life.hears(10.0, 0)
    life.state.plan.dispatched(dispatch(0, "ask", ("p", "a"), plan=7), 10.0)
    life.state.plan.feedback(feedback(0, 2, plan=7), 14.0)
    life.state.plan.dispatched(dispatch(1, "ask", ("p", "b"), plan=7), 14.0)
    life.hears(14.0, 1, first=False)
    warm = DiagnosticStatus(name="arm: motor", level=DiagnosticStatus.WARN)
    life.state.health.diagnostics(DiagnosticArray(status=[warm]), 14.0, 1.0)
    life.state.refresh_problems(1.0)
    life.state.acknowledge("part arm: motor warning", "Ana", 14.0)
    return life


@pytest.mark.parametrize("plan_first", [True, False])
def test_finished_steps_stay_finished_and_the_run_goes_on(tmp_path: Path, plan_first: bool) -> None:
    first = before(tmp_path)
    run = first.state.history.run
    first.state.stop()
    life = Life(tmp_path, 1020.0)
    assert life.state.history.run == run
    if plan_first:
        life.state.planned(*sequential_steps(PLAN), 34.0)
    life.hears(34.0, 2, first=not plan_first)
    assert life.states == ["succeeded", "succeeded", "dispatched", "waiting"]
    assert (life.steps[0]["began"], life.steps[0]["ended"]) == (5.0, 14.0)
    assert life.reported.texts == ["the monitor was started again"], "nothing is reported twice"
    ended = ExecuteActionResult(result=ExecuteResult(outcome=ExecuteResult.SUCCEEDED))
    ended.status = GoalStatus(goal_id=GoalID(id=REQUEST))
    life.state.now.result(ended, 36.0)
    assert life.reported.texts[-1] == "“a”: succeeded after 26.0 s", "it began before"
    warm = DiagnosticStatus(name="arm: motor", level=DiagnosticStatus.WARN)
    life.state.health.diagnostics(DiagnosticArray(status=[warm]), 34.0, 2.0)
    life.state.refresh_problems(2.0)
    assert [each["by"] for each in life.state.tree.get("now", "problems")] == ["Ana"]
    reader = life.state.history
    (known,) = reader.runs().result(LONG)
    assert known["run"] == run and known["began"] == pytest.approx(1000.0, abs=0.001)
    life.state.stop()


@pytest.mark.parametrize("plan_first", [True, False])
def test_a_plan_is_as_old_as_when_it_was_first_heard(tmp_path: Path, plan_first: bool) -> None:
    first = Life(tmp_path, 1000.0)
    for at in (5.0, 10.0):  # the second plan is carried out
        first.state.planned(*sequential_steps(PLAN), at)
    first.hears(12.0, 1, first=False)
    first.state.stop()
    life = Life(tmp_path, 1020.0)
    if plan_first:
        life.state.planned(*sequential_steps(PLAN), 34.0)
    life.hears(34.0, 2, first=not plan_first)
    plan = life.state.tree.get("plan")
    assert (plan["at"], plan["number"]) == (10.0, 2)
    life.state.planned(*sequential_steps(PLAN), 40.0)
    plan = life.state.tree.get("plan")
    assert (plan["at"], plan["number"]) == (40.0, 3)
    life.state.stop()


@pytest.mark.parametrize("plan_first", [True, False])
def test_without_a_history_it_is_not_known_how_old_a_plan_is(tmp_path: Path, plan_first: bool) -> None:
    life = Life(tmp_path, 1020.0, kept=False)
    if plan_first:
        life.state.planned(*sequential_steps(PLAN), 34.0)
    life.hears(34.0, 2, first=not plan_first)
    assert life.state.tree.get("plan", "at", default=0.0) is None
    life.state.planned(*sequential_steps(PLAN), 40.0)
    assert life.state.tree.get("plan", "at") == 40.0
    life.state.stop()


def test_the_knowledge_says_as_before_by_whom_it_was_changed(tmp_path: Path) -> None:
    first = before(tmp_path)
    knowledge = first.state.knowledge
    knowledge.replace(Contents({}, [fact("a")], [value("n", number=1.0)], []), "", 10.0, True)
    knowledge.changed(changes("/ana", version=5, added=[fact("b"), fact("c")]), 12.0)
    first.state.tree.set("meta", "time", 14.0)
    first.state.stop()
    life = Life(tmp_path, 1020.0)
    facts = [fact("a"), fact("b"), fact("d")]
    life.state.knowledge.replace(Contents({}, facts, [value("n", number=2.0)], []), "", 34.0, True)
    shown = life.state.tree.get("knowledge")
    assert shown["facts"] == {
        "(a)": {},
        "(b)": {"by": "/ana", "at": 12.0, "version": 5},
        "(d)": {"by": "", "at": 34.0, "after": 14.0},
    }
    assert shown["values"] == {"(n)": {"value": 2.0, "by": "", "at": 34.0, "after": 14.0}}
    assert life.reported.texts == ["the monitor was started again"] and shown["recent"] == {}
    life.state.stop()


def test_when_simulated_time_was_set_back_stays_known(tmp_path: Path) -> None:
    first = before(tmp_path)
    first.state.tree.set("meta", "set_back", 1000.5)
    first.state.stop()
    life = Life(tmp_path, 1020.0)
    assert life.state.tree.get("meta", "set_back") == 1000.5
    life.state.stop()


def test_without_a_history_the_dispatcher_tells(tmp_path: Path) -> None:
    life = Life(tmp_path, 1020.0, kept=False)
    life.hears(34.0, 2)
    assert life.states == ["succeeded", "succeeded", "dispatched", "waiting"]
    assert "ended" not in life.steps[0]
    life.state.stop()


def over(done: int = 4, **fields: Any) -> DispatchStatus:
    return DispatchStatus(state=DispatchStatus.IDLE, plan_id=7, steps_done=done, steps_total=4, **fields)


@pytest.mark.parametrize("plan_first", [True, False])
def test_who_comes_after_the_end_sees_how_it_ended(tmp_path: Path, plan_first: bool) -> None:
    for status, states in (
        (over(), ["succeeded"] * 4),
        (
            over(1, failed_action="(ask a)", reason="(ask a) failed: no voice"),
            ["failed", "succeeded", "dropped", "dropped"],
        ),
    ):
        life = Life(tmp_path, 1020.0, kept=False)
        if plan_first:
            life.state.planned(*sequential_steps(PLAN), 34.0)
        life.state.plan.dispatcher(status, 34.0)
        if not plan_first:
            life.state.planned(*sequential_steps(PLAN), 34.0)
        assert life.states == states
        life.state.plan.dispatched(dispatch(0, "ask", ("p", "a"), plan=7), 34.1)  # latched
        assert life.states == states
        life.state.plan.dispatched(dispatch(0, "ask", ("p", "a"), plan=8), 34.2)  # the same plan once more
        assert life.states == ["dispatched", "waiting", "waiting", "waiting"]
        life.state.stop()


def test_the_end_of_a_dispatch_is_not_that_of_the_next_one(tmp_path: Path) -> None:
    life = Life(tmp_path, 1020.0, kept=False)
    life.state.plan.dispatched(dispatch(0, "ask", ("p", "a"), plan=8), 34.0)
    life.state.plan.dispatcher(over(), 34.0)
    life.state.planned(*sequential_steps(PLAN), 34.0)
    assert life.states == ["dispatched", "waiting", "waiting", "waiting"]
    life.state.stop()


def test_another_plan_is_not_taken_for_the_one_of_before(tmp_path: Path) -> None:
    before(tmp_path).state.stop()
    life = Life(tmp_path, 1020.0)
    life.state.planned(*sequential_steps(CompletePlan(PLAN.plan[:2])), 34.0)
    life.hears(34.0, 2, first=False)
    assert life.states == ["waiting", "waiting"]
    assert any(text.startswith("plan of 2 steps") for text in life.reported.texts)
    life.state.stop()


def test_another_session_a_clock_that_went_back_and_a_long_gap_begin_a_run(tmp_path: Path) -> None:
    before(tmp_path).state.stop()
    later = ((1020.0, "two"), (900.0, "one"), (1030.0, ""), (2000.0, "one"))
    for number, (wall, session) in enumerate(later, 2):
        life = Life(tmp_path, wall, session)
        assert life.state.history.run == number
        assert life.reported.texts == []
        life.state.stop()

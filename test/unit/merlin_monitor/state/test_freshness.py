"""What is shown is marked when its source is gone or hangs."""

from typing import Tuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from merlin_msgs.msg import ExecutorStatus, MissionStatus
from messages import Told, dispatch, executor, running
from rosplan_dispatch_msgs.msg import CompletePlan

from merlin_monitor.state.freshness import Source
from merlin_monitor.state.health_section import LONGEST_PERIOD, SILENT_AFTER
from merlin_monitor.state.inbox import Inbox
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_monitor.state.plan_order import sequential_steps

EXECUTOR = "/ann/merlin_executor"


def model() -> Tuple[MonitorModel, Told]:
    state, told = MonitorModel(Inbox()), Told()
    state.on_event = told
    return state, told


def report(state: MonitorModel, wall: float, *names: str) -> None:
    message = DiagnosticArray(status=[DiagnosticStatus(name=name) for name in names])
    state.health.diagnostics(message, wall, wall)


def check(state: MonitorModel, wall: float, connected: bool = True) -> None:
    state.health.check_silence(wall, wall)
    source = Source(connected, EXECUTOR if connected else "")
    state.freshness.check(wall, {"now": source, "queue": source})
    state.now.refresh()


def test_a_source_that_was_never_there_is_not_missed() -> None:
    state, told = model()
    check(state, 0.0, connected=False)
    assert state.tree.get("now", "silent") is None and told == []


def test_an_executor_that_is_gone_is_the_headline() -> None:
    state, told = model()
    drive = executor(
        ExecutorStatus.RUNNING, goals=["(a)"], running=[running(0, "navigate", ("to", "kitchen"))]
    )
    state.now.executor(drive, 0.5)
    check(state, 1.0)
    assert state.tree.get("now", "doing") == "navigating to kitchen"
    check(state, 1.5, connected=False)
    assert state.tree.get("now", "doing") == "not known: the Executor is gone"
    assert state.tree.get("now", "because") == "before: navigating to kitchen"
    assert state.tree.get("queue", "silent") == {"node": EXECUTOR, "what": "is gone", "since": 1.0}
    check(state, 2.0, connected=False)
    check(state, 2.5)
    assert state.tree.get("now", "doing") == "navigating to kitchen"
    assert state.tree.get("now", "silent") is None
    assert told.texts[-2:] == [f"{EXECUTOR} is gone", f"{EXECUTOR} is connected again"]


def test_an_executor_that_hangs_does_not_answer() -> None:
    state, _ = model()
    for second in range(3):
        report(state, float(second), "ann/merlin_executor: requests")
        check(state, float(second))
    check(state, 2.1 + SILENT_AFTER)
    assert state.tree.get("now", "doing") == "not known: the Executor does not answer"


def test_another_node_that_is_silent_is_trouble() -> None:
    state, _ = model()
    names = ("ann/merlin_executor: requests", "ann/navigation: planner", "ann/navigation: sensors")
    for second in range(3):
        report(state, float(second), *names)
        check(state, float(second))
    assert state.tree.get("now", "trouble") == []
    report(state, 4.0, *names[:2])
    check(state, 5.0)
    assert state.tree.get("now", "trouble") == []  # a part of it is heard
    report(state, 9.5, names[0])
    check(state, 10.0)
    assert state.tree.get("now", "trouble") == ["ann/navigation does not answer"]


def test_a_part_that_reports_every_ten_seconds_is_silent_later() -> None:
    state, told = model()
    for wall in (0.0, 10.0, 20.0, 30.0):
        report(state, wall, "slow: part")
    told.clear()
    state.health.check_silence(45.0, 45.0)
    assert told == []
    state.health.check_silence(56.0, 56.0)
    assert told.texts == ["slow: part has fallen silent"]


def test_one_long_pause_is_forgotten_soon() -> None:
    state, told = model()
    wall = 2 * LONGEST_PERIOD
    report(state, 0.0, "part: of")
    for second in range(8):
        report(state, wall + second, "part: of")
    told.clear()
    state.health.check_silence(wall + 7.1 + SILENT_AFTER, wall + 7.1 + SILENT_AFTER)
    assert told.texts == ["part: of has fallen silent"]


def test_the_steps_of_a_request_that_has_ended_do_not_wait() -> None:
    state, _ = model()
    state.plan.planned(*sequential_steps(CompletePlan([dispatch(0, "a"), dispatch(1, "b")])), 0.0)
    state.plan.dispatched(dispatch(0, "a"), 1.0)
    state.plan.request_ended()
    steps = state.tree.get("plan", "steps")
    assert [steps[key]["state"] for key in ("0", "1")] == ["dispatched", "dropped"]
    assert state.plan.step("(b)") is None


def test_the_end_of_a_mission_is_the_headline() -> None:
    state, _ = model()
    state.now.executor(executor(ExecutorStatus.IDLE), 0.0)
    end = MissionStatus(
        mission="Mission 1", state=MissionStatus.SUCCEEDED, task=6, tasks=6, description="6 of 6 as planned"
    )
    state.now.mission(end, 1.0)
    assert state.tree.get("now", "doing") == "Mission 1 has ended: 6 of 6 as planned"
    assert state.tree.get("now", "last") is None

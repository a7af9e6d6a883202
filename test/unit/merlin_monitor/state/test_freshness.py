# SPDX-License-Identifier: Apache-2.0
"""What is shown is marked when its source is gone or hangs."""

from typing import Tuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from merlin_msgs.msg import ExecutorStatus, GoalQueue, GuardStatus, MissionStatus
from messages import Reported, dispatch, executor, running
from rosplan_dispatch_msgs.msg import CompletePlan

from merlin_monitor.state.freshness import Source
from merlin_monitor.state.health_section import LONGEST_PERIOD, SILENT_AFTER
from merlin_monitor.state.inbox import Inbox
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_monitor.state.plan_steps import sequential_steps
from merlin_monitor.text.phrase import in_english
from merlin_monitor.truth.problems import OVER
from merlin_ros.health import ENDED, STALE

EXECUTOR = "/ann/merlin_executor"


def model() -> Tuple[MonitorModel, Reported]:
    state, reported = MonitorModel(Inbox()), Reported()
    state.on_event = reported
    return state, reported


def report(state: MonitorModel, wall: float, *names: str) -> None:
    message = DiagnosticArray(status=[DiagnosticStatus(name=name) for name in names])
    state.health.diagnostics(message, wall, wall)


def check(state: MonitorModel, wall: float, connected: bool = True) -> None:
    state.health.check_silence(wall, wall)
    source = Source(connected, EXECUTOR if connected else "")
    state.freshness.check(wall, {"now": source, "queue": source})
    state.now.refresh()


def test_a_source_that_was_never_there_is_not_missed() -> None:
    state, reported = model()
    check(state, 0.0, connected=False)
    assert state.tree.get("now", "silent") is None and reported == []


def test_an_executor_that_is_gone_is_the_headline() -> None:
    state, reported = model()
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
    check(state, 2.3)
    assert state.tree.get("now", "doing") == "not known: the Executor is gone", "that was in its life before"
    state.now.executor(drive, 2.4)
    state.now.queue(GoalQueue(), 2.4)
    check(state, 2.5)
    assert state.tree.get("now", "doing") == "navigating to kitchen"
    assert state.tree.get("now", "silent") is None and state.tree.get("queue", "silent") is None
    assert reported.texts[-2:] == [f"{EXECUTOR} is gone", f"{EXECUTOR} is connected again"]


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
    state, reported = model()
    for wall in (0.0, 10.0, 20.0, 30.0):
        report(state, wall, "slow: part")
    reported.clear()
    state.health.check_silence(45.0, 45.0)
    assert reported == []
    state.health.check_silence(56.0, 56.0)
    assert reported.texts == ["slow: part has fallen silent"]


def test_one_long_pause_is_forgotten_soon() -> None:
    state, reported = model()
    wall = 2 * LONGEST_PERIOD
    report(state, 0.0, "part: of")
    for second in range(8):
        report(state, wall + second, "part: of")
    reported.clear()
    state.health.check_silence(wall + 7.1 + SILENT_AFTER, wall + 7.1 + SILENT_AFTER)
    assert reported.texts == ["part: of has fallen silent"]


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


def test_owners_without_a_section_are_the_headline_while_they_matter() -> None:
    state, reported = model()
    state.now.executor(executor(ExecutorStatus.IDLE), 0.0)
    state.now.mission(MissionStatus(mission="Round", state=MissionStatus.RUNNING, description="a"), 0.0)

    def look(wall: float, connected: bool = True, node: str = "/mission") -> None:
        state.health.check_silence(wall, wall)
        state.freshness.check(wall, {}, {"mission": Source(connected, node)})
        state.now.refresh()

    for second in range(3):
        report(state, float(second), "mission: mission")
        look(float(second))
    assert state.tree.get("now", "doing") == "idle" and state.tree.get("now", "known")
    look(2.1 + SILENT_AFTER)
    assert state.tree.get("now", "doing") == "not known: Round does not answer"
    assert state.tree.get("now", "because") == "before: a"
    assert in_english(state.tree.get("now", "state")) == "Not known" and not state.tree.get("now", "known")
    assert state.tree.get("now", "trouble") == [], "it is said once"
    report(state, 6.0, "mission: mission")
    look(6.0)
    assert state.tree.get("now", "doing") == "idle"
    look(7.0, connected=False)
    assert state.tree.get("now", "doing") == "not known: Round is gone"
    # One that ends as it should is not missed.
    state.now.mission(MissionStatus(mission="Round", state=MissionStatus.SUCCEEDED), 8.0)
    reported.clear()
    state.freshness.check(8.0, {}, {})
    state.now.refresh()
    assert state.tree.get("now", "doing") == "Round has ended: no more"
    assert reported.texts == ["/mission is connected again"]


def test_an_executor_that_is_back_is_not_silent_as_the_one_before() -> None:
    state, _ = model()
    drive = [running(0, "navigate", ("to", "kitchen"))]
    state.now.executor(executor(ExecutorStatus.RUNNING, running=drive), 0.0)
    for second in range(3):
        report(state, float(second), "ann/merlin_executor: requests")
        check(state, float(second))
    check(state, 3.0, connected=False)
    check(state, 2.1 + SILENT_AFTER, connected=False)
    assert state.tree.get("now", "doing") == "not known: the Executor is gone"
    check(state, 2.6 + SILENT_AFTER)  # its first words are on their way
    assert state.tree.get("now", "doing") == "not known: the Executor is gone"
    state.now.executor(executor(ExecutorStatus.IDLE), 5.4)
    state.now.queue(GoalQueue(), 5.5)
    check(state, 5.5)
    assert state.tree.get("now", "doing") == "idle"
    for second in range(3):
        report(state, 6.0 + second, "ann/merlin_executor: requests")
    check(state, 8.1 + SILENT_AFTER)
    assert state.tree.get("now", "doing") == "not known: the Executor does not answer"


def test_a_planning_system_that_is_gone_is_not_said_to_hang() -> None:
    state, _ = model()
    state.now.executor(executor(ExecutorStatus.RUNNING), 0.0)
    node = "/planning_system"
    for second in range(3):
        report(state, float(second), "planning_system: a")
        state.freshness.check(2.0, {"plan": Source(True, node), "knowledge": Source(True, node)})
    state.health.check_silence(9.0, 9.0)
    # Others publish on the dispatcher's topic, too.
    state.freshness.check(9.0, {"plan": Source(True, node), "knowledge": Source(False, node)})
    state.now.refresh()
    assert state.tree.get("now", "doing") == "not known: the planning system is gone"


def test_of_two_navigation_servers_the_one_that_is_gone_is_named_or_that_hangs() -> None:
    state, _ = model()
    ann, bob = "/ann/navigation", "/bob/navigation"
    for second in range(3):
        report(state, float(second), "ann/navigation: a", "bob/navigation: a")
    for source, wall, said in (
        (Source(True, ann, (bob,)), 2.0, []),
        (Source(False, bob, (ann,)), 2.5, ["the navigation server (bob/navigation) is gone"]),
        (Source(True, ann, (bob,)), 2.6, []),
    ):
        state.freshness.check(wall, {}, {"navigation": source})
        state.now.refresh()
        assert state.tree.get("now", "trouble") == said
    report(state, 5.0, "ann/navigation: a")
    state.health.check_silence(5.0, 5.0)
    state.freshness.check(5.0, {}, {"navigation": Source(True, ann, (bob,))})
    state.now.refresh()
    assert state.tree.get("now", "trouble") == ["the navigation server (bob/navigation) does not answer"]


def test_the_dispatcher_that_hangs_is_the_headline_while_something_runs() -> None:
    state, _ = model()
    for runs, said in ((True, "not known: the planning system is gone"), (False, "idle")):
        status = ExecutorStatus.RUNNING if runs else ExecutorStatus.IDLE
        state.now.executor(executor(status, running=[running(0, "navigate", ("to", "kitchen"))] * runs), 0.5)
        for connected in (True, False):
            state.freshness.check(1.0, {"plan": Source(connected, "/planning_system")})
        state.now.refresh()
        assert state.tree.get("now", "doing") == said


def test_a_node_that_ends_in_order_is_not_silent() -> None:
    state, reported = model()
    names = [DiagnosticStatus(name=f"{node}: part") for node in ("players", "camera")]
    for second in range(3):
        for status in names:
            node = f"/{status.name.partition(':')[0]}"
            state.health.diagnostics(DiagnosticArray(status=[status]), 0.0, float(second), node)
    reported.clear()
    state.health.check_silence(3.1 + SILENT_AFTER, 3.1 + SILENT_AFTER, ["/camera"])
    assert reported.texts == ["camera: part has fallen silent", "/players has ended"]
    assert state.health.silent_nodes() == ["camera"]
    assert list(state.tree.get("health", "parts")) == ["camera: part"]


def test_a_node_that_says_that_it_ends_is_not_silent() -> None:
    """Also of a recording, whose nodes stay publishers and which a player publishes."""
    state, reported = model()
    names, player = ("ann/merlin_executor: a", "ann/merlin_executor: b", "camera: a"), "/player"
    for second in range(3):
        well = DiagnosticArray(status=[DiagnosticStatus(name=name) for name in names])
        state.health.diagnostics(well, 0.0, float(second), player)
    reported.clear()
    last = [DiagnosticStatus(name=name, level=STALE, message=ENDED) for name in names[:2]]
    state.health.diagnostics(DiagnosticArray(status=last), 2.5, 2.5, player)
    assert reported.texts == ["/ann/merlin_executor has ended"]
    state.health.diagnostics(DiagnosticArray(status=last), 2.6, 2.6, player)
    state.health.check_silence(3.1 + SILENT_AFTER, 3.1 + SILENT_AFTER, [player])
    assert reported.texts == ["/ann/merlin_executor has ended", "camera: a has fallen silent"]
    assert state.health.silent_nodes() == ["camera"]
    assert list(state.tree.get("health", "parts")) == ["camera: a"]


def test_a_problem_that_an_operator_knows_is_reported_and_stays_known() -> None:
    state, reported = model()
    warm = DiagnosticStatus(name="arm: motor", level=DiagnosticStatus.WARN, message="warm")
    state.health.diagnostics(DiagnosticArray(status=[warm]), 1.0, 1.0)
    state.refresh_problems(1.0)
    (problem,) = state.tree.get("now", "problems")
    state.acknowledge(problem["key"], "Ana", 2.0)
    state.acknowledge("part of the moon", "Ana", 2.0)
    assert reported.texts[-1] == "Ana knows: arm: motor: warm" and reported[-1].detail["by"] == "Ana"
    state.refresh_problems(3.0)
    assert [each["by"] for each in state.tree.get("now", "problems")] == ["Ana"]
    well = DiagnosticStatus(name="arm: motor", level=DiagnosticStatus.OK)
    for status, at in ((well, 4.0), (well, 4.0 + 2 * OVER), (warm, 5.0 + 2 * OVER)):
        state.health.diagnostics(DiagnosticArray(status=[status]), at, at)
        state.refresh_problems(at)
    assert [each["by"] for each in state.tree.get("now", "problems")] == [""], "it is a new one"


def test_what_moves_the_base_is_asked_for_while_the_robot_drives() -> None:
    state, _ = model()
    drive = running(0, "navigate", ("to", "kitchen"))
    state.now.executor(executor(ExecutorStatus.RUNNING, running=[drive]), 0.5)
    for connected in (True, False):
        state.freshness.check(1.0, {}, {"navigation": Source(connected, "/navigation")})
    state.now.refresh()
    assert state.tree.get("now", "doing") == "navigating to kitchen; but the navigation server is gone"
    assert state.tree.get("now", "trouble") == [], "it is said once"
    state.guard.status(GuardStatus(state=GuardStatus.PASSING), 1.0, 1.0)
    state.now.refresh()
    assert state.tree.get("now", "doing") == "not known: the navigation server is gone"
    assert state.tree.get("now", "because") == "before: navigating to kitchen"
    state.freshness.check(2.0, {}, {"navigation": Source(True, "/navigation")})
    state.guard.status(GuardStatus(state=GuardStatus.HOLDING, reason="its owner is silent"), 2.0, 2.0)
    state.guard.check_silence(3.0, 3.0)
    state.now.refresh()
    assert state.tree.get("now", "doing") == "the base is held: its owner is silent"
    assert state.tree.get("now", "because") == "the Executor: navigating to kitchen"
    state.map.goal((1.0, 1.0, 0.0), 3.0)
    state.guard.check_silence(9.0, 9.0)
    state.now.refresh()
    assert state.tree.get("now", "doing") == "not known: the velocity guard does not answer"


def test_one_of_several_processes_of_the_actions_is_enough() -> None:
    state, _ = model()
    action = running(0, "ask", ("p", "kitchen"))
    state.now.executor(executor(ExecutorStatus.RUNNING, running=[action]), 0.5)
    hosts = {"machines": Source(True, "/host_1", ("/host_2",))}
    for second in range(3):
        report(state, float(second), "host_1: ask", "host_2: navigate")
        state.freshness.check(float(second), {}, hosts)
    for wall in (4.0, 6.0):
        report(state, wall, "host_1: ask")
    state.health.check_silence(6.0, 6.0)
    state.freshness.check(6.0, {}, hosts)
    state.now.refresh()
    assert state.tree.get("now", "doing") == "not known: the process of the state machines does not answer"
    assert state.tree.get("now", "lost", "machines", "node") == "/host_2"
    assert state.tree.get("now", "trouble") == [] and state.freshness.others_silent() == []

# SPDX-License-Identifier: Apache-2.0
"""The line that says what the robot does, and why."""

import sys
import threading
from typing import Any, Dict, List, Set, Tuple

import pytest
import rospy
from actionlib_msgs.msg import GoalID, GoalStatus
from merlin_msgs.msg import (
    ExecuteActionResult,
    ExecuteResult,
    ExecutorStatus,
    GoalQueue,
    GuardStatus,
    MachineHolds,
    MissionStatus,
    QueuedGoal,
)
from messages import Reported, dispatch, executor, feedback, running
from rosplan_dispatch_msgs.msg import CompletePlan

from merlin_monitor.state.freshness import Freshness
from merlin_monitor.state.guard_section import GuardSection
from merlin_monitor.state.health_section import HealthSection
from merlin_monitor.state.machine_section import HELD_SILENT_AFTER, MachineSection
from merlin_monitor.state.now_section import NowSection
from merlin_monitor.state.plan_section import PlanSection
from merlin_monitor.state.plan_steps import sequential_steps
from merlin_monitor.state.state_tree import StateTree
from merlin_monitor.text.phrase import action_in_words, gerund, in_english, listed
from merlin_monitor.text.wording import Wording

REQUEST = "/mission-1-12.5"


def section() -> Tuple[StateTree, NowSection, PlanSection, Reported]:
    tree, reported = StateTree(), Reported()
    wording = Wording()
    wording.places = {"kitchen", "dorm_room"}
    plan = PlanSection(tree, reported, wording)
    freshness = Freshness(tree, reported, HealthSection(tree, reported))
    now = NowSection(tree, reported, plan, MachineSection(tree, reported, lambda key: None), freshness)
    return tree, now, plan, reported


def test_a_request_of_another_client_is_not_the_missions() -> None:
    tree, now, _, _ = section()
    now.mission(MissionStatus(mission="mission 1", state=MissionStatus.RUNNING), 0.0, "/mission")
    for request, who in ((REQUEST, "mission 1"), ("/merlin_monitor-1-13.0", "/merlin_monitor")):
        now.executor(
            executor(ExecutorStatus.RUNNING, request=request, goals=["(checked hall)"], stage="PLAN"), 1.0
        )
        assert tree.get("now", "because") == f"for “hall checked”, asked for by {who}"


def test_an_operators_goal_has_the_operators_name_and_is_no_task_of_the_mission() -> None:
    tree, now, _, reported = section()
    mission = MissionStatus(mission="Round", state=MissionStatus.RUNNING, task=3, tasks=6)
    now.mission(mission, 0.0, "/mission")
    now.executor(executor(ExecutorStatus.RUNNING, request=REQUEST, goals=["(checked hall)"]), 1.0)
    assert tree.get("now", "executor", "mission") is True
    assert tree.get("now", "chain")[0][0] == "mission"
    now.executor(
        executor(ExecutorStatus.RUNNING, request="/page-1-13.0", goals=["(checked dorm)"], by="Ana"), 2.0
    )
    assert tree.get("now", "because") == "for “dorm checked”, asked for by Ana"
    assert tree.get("now", "executor", "mission") is False
    assert [level[0] for level in tree.get("now", "chain")] == ["goal"]
    assert "“dorm checked” asked for by Ana" in reported.texts
    # Its node is the mission's, too: a mission that has a page in its own process.
    now.executor(executor(ExecutorStatus.RUNNING, request=REQUEST, goals=["(checked a)"], by="Ana"), 3.0)
    assert tree.get("now", "executor", "mission") is False
    now.executor(executor(ExecutorStatus.IDLE), 4.0)
    assert tree.get("now", "chain")[0][0] == "mission", "between two goals the mission is what goes on"


def test_requests_that_run_in_one_plan_are_all_reported() -> None:
    tree, now, plan, reported = section()
    others = [
        QueuedGoal(request=f"/page-1-{name}", goals=[f"(checked {name})"], by=by)
        for name, by in (("dorm", "Ana"), ("bath", "Bob"), ("door", "Ana"))
    ]
    now.executor(
        executor(
            ExecutorStatus.RUNNING, request=REQUEST, goals=["(checked hall)"], by="Ana", together=others
        ),
        1.0,
    )
    because = "for “hall checked, dorm checked, bath checked and 1 more”, asked for by Ana and Bob"
    assert tree.get("now", "because") == because
    shown = tree.get("now", "executor", "together")
    assert [(each["request"], each["by"], each["running"]) for each in shown] == [
        ("/page-1-dorm", "Ana", True),
        ("/page-1-bath", "Bob", True),
        ("/page-1-door", "Ana", True),
    ]
    assert "“bath checked” asked for by Bob" in reported.texts
    count = len(reported.texts)
    # The first one ends: another one is the first now, with the same plan.
    now.executor(
        executor(ExecutorStatus.RUNNING, request="/page-1-dorm", goals=["(checked dorm)"], by="Ana"), 2.0
    )
    assert len(reported.texts) == count


def test_the_pace_of_a_mission_is_reported_where_its_end_is_known() -> None:
    tree, now, _, reported = section()
    for tasks, known in ((6, True), (0, False)):
        for task, at in ((1, 10.0), (2, 30.0), (2, 31.0)):
            now.mission(MissionStatus(mission="Round", state=1, task=task, tasks=tasks), at, "/mission")
        shown = tree.get("now", "mission")
        assert ((shown.get("pace"), shown.get("since")) == (20.0, 30.0)) is known
    now.mission(MissionStatus(mission="Round", state=3, task=2, tasks=6), 50.0, "/mission")
    assert "pace" not in tree.get("now", "mission"), "it has ended"
    assert reported.texts[:2] == ["Round running, task 1 of 6", "Round running, task 2 of 6"]


def test_a_breakpoint_is_in_the_headline_and_the_history() -> None:
    tree, now, _, reported = section()
    action = running(1, "navigate", ("from", "kitchen"), ("to", "hall"))
    held = "(ask hall)"
    now.executor(
        executor(ExecutorStatus.RUNNING, request=REQUEST, running=[action], held=held),
        1.0,
    )
    assert tree.get("now", "doing").endswith(", then held before (ask hall)")
    now.executor(executor(ExecutorStatus.RUNNING, request=REQUEST, held=held), 2.0)
    assert tree.get("now", "doing") == "held before (ask hall)"
    assert reported.texts.count("held before (ask hall)") == 1
    now.executor(executor(ExecutorStatus.RUNNING, request=REQUEST, stage="DISPATCH_PLAN"), 3.0)
    assert "held" not in tree.get("now", "doing")


def test_a_machine_that_is_held_is_the_headline_until_its_node_is_gone() -> None:
    tree, now, plan, reported = section()
    machines = now._machines
    action = running(1, "navigate", ("from", "kitchen"), ("to", "hall"))
    now.executor(executor(ExecutorStatus.RUNNING, request=REQUEST, running=[action]), 1.0)
    for wall in (1.0, 2.0):
        machines.holds(
            MachineHolds(node="/host", breakpoints=["*/DRIVE"], held=["NAVIGATE/DRIVE"]), 1.0, wall
        )
    now.refresh()
    assert tree.get("now", "doing") == "held before state DRIVE of NAVIGATE"
    assert reported.texts.count("held before state DRIVE of NAVIGATE") == 1
    assert machines.held == ["NAVIGATE/DRIVE"] and machines.may_be_held
    assert not machines.check_holds(2.0 + HELD_SILENT_AFTER)
    assert machines.check_holds(2.1 + HELD_SILENT_AFTER)
    now.refresh()
    assert tree.get("now", "doing").startswith("navigating")
    machines.holds(MachineHolds(node="/host", breakpoints=["*/DRIVE"]), 1.0, 9.0)
    assert not machines.check_holds(99.0) and machines.may_be_held, "only one that holds has a heartbeat"
    machines.holds(MachineHolds(node="/host", autonomy="low"), 1.0, 9.0)
    assert machines.may_be_held, "at any moment an outcome may wait"
    machines.holds(MachineHolds(node="/host", autonomy="full"), 1.0, 10.0)
    assert not machines.may_be_held


def test_an_outcome_that_waits_for_an_operator_is_the_headline_until_its_node_is_gone() -> None:
    tree, now, plan, reported = section()
    machines = now._machines
    waits = {"confirm": ["GRASP/CLOSE"], "confirm_outcomes": ["succeeded"], "autonomy": "low"}
    for wall in (1.0, 2.0):
        machines.holds(MachineHolds(node="/host", **waits), 1.0, wall)
    now.refresh()
    said = "succeeded of GRASP/CLOSE waits for an operator"
    assert tree.get("now", "doing") == said and reported.texts.count(said) == 1
    assert "autonomy level" in tree.get("now", "because")
    assert machines.unconfirmed == [("GRASP/CLOSE", "succeeded")] and machines.may_be_held
    assert machines.check_holds(2.1 + HELD_SILENT_AFTER)
    now.refresh()
    assert tree.get("now", "doing") != said


def test_a_pause_is_in_the_headline() -> None:
    tree, now, _, _ = section()
    action = running(1, "navigate", ("from", "kitchen"), ("to", "hall"))
    now.executor(executor(ExecutorStatus.RUNNING, request=REQUEST, running=[action], paused=True), 1.0)
    assert tree.get("now", "doing").endswith(", then pausing")
    now.executor(executor(ExecutorStatus.IDLE, paused=True), 2.0)
    assert tree.get("now", "doing") == "paused"
    now.executor(executor(ExecutorStatus.IDLE), 3.0)
    assert tree.get("now", "doing") == "idle"


def test_a_held_base_is_the_headline_whatever_the_executor_does() -> None:
    tree, now, _, reported = section()
    now.executor(executor(ExecutorStatus.IDLE), 1.0)
    guard = GuardSection(tree, reported)
    stopped = GuardStatus(state=GuardStatus.STOPPED, reason="stopped by Ana", since=rospy.Time(42.5))
    guard.status(stopped, 43.0, 1.0)
    now.refresh()
    assert tree.get("now", "doing") == "stopped and held by Ana since 42.5 s"
    assert tree.get("now", "because") == "the Executor: idle"
    guard.status(GuardStatus(state=GuardStatus.IDLE), 44.0, 1.0)
    now.refresh()
    assert tree.get("now", "doing") == "idle"


def test_a_request_that_is_gone_on_with_began_when_it_began() -> None:
    _, now, _, reported = section()
    for request, at in ((REQUEST, 1.0), ("", 5.0), ("/other-1-5.0", 6.0), ("", 7.0), (REQUEST, 8.0)):
        state = ExecutorStatus.RUNNING if request else ExecutorStatus.IDLE
        goals = ["(checked kitchen)"] if request else []
        now.executor(executor(state, request=request, goals=goals, stage="PLAN" if request else ""), at)
    result = ExecuteActionResult(result=ExecuteResult(outcome=ExecuteResult.SUCCEEDED))
    result.status = GoalStatus(goal_id=GoalID(id=REQUEST))
    now.result(result, 11.0)
    texts = [event.text for event in reported]
    assert texts[-2:] == ["goes on with “kitchen checked”", "“kitchen checked”: succeeded after 10.0 s"]


def test_what_why_and_which_step() -> None:
    tree, now, plan, _ = section()
    now.mission(MissionStatus(mission="mission 1", state=MissionStatus.RUNNING, task=2, tasks=6), 0.0)
    steps = [
        dispatch(0, "navigate", ("from", "hall"), ("to", "kitchen")),
        dispatch(1, "ask", ("p", "kitchen")),
    ]
    plan.planned(*sequential_steps(CompletePlan(steps)), 0.0)
    now.executor(
        executor(
            ExecutorStatus.RUNNING,
            request=REQUEST,
            goals=["(checked kitchen)"],
            steps_total=2,
            steps_done=1,
            stage="DISPATCH_PLAN",
            running=[running(1, "ask", ("p", "kitchen"))],
        ),
        1.0,
    )
    line = tree.get("now")
    assert line["doing"] == "asking at the kitchen"
    assert line["because"] == "for “kitchen checked”, asked for by mission 1"
    assert line["step"] == "step 2 of 2"
    chain = [(what, in_english(words), *pddl) for what, words, *pddl in line["chain"]]
    assert chain[:3] == [
        ("mission", "mission 1, task 2 of 6"),
        ("goal", "kitchen checked", "(checked kitchen)"),
        ("action", "asking at the kitchen", "(ask kitchen)"),
    ]


def test_before_anything_and_when_idle() -> None:
    tree, now, _, _ = section()
    assert tree.get("now", "doing") == "nothing heard yet"
    now.executor(executor(ExecutorStatus.IDLE), 0.0)
    assert tree.get("now", "doing") == "idle" and tree.get("now", "because") == ""
    now.mission(MissionStatus(mission="m", state=MissionStatus.PAUSED), 0.0)
    assert tree.get("now", "doing") == "paused"


def test_without_a_mission_the_node_that_asked_is_named() -> None:
    tree, now, _, _ = section()
    now.executor(
        executor(ExecutorStatus.RUNNING, request="/my/node-3-1234.000", goals=["(a)"], stage="PLAN"), 0.0
    )
    assert tree.get("now", "doing") == "planning"
    assert tree.get("now", "because") == "for “a”, asked for by /my/node"


def test_a_cancel_says_what_stops() -> None:
    tree, now, _, _ = section()
    status = executor(
        ExecutorStatus.CANCELLING, goals=["(a)"], running=[running(0, "drive", ("to", "kitchen"))]
    )
    now.executor(status, 0.0)
    assert tree.get("now", "doing") == "stopping driving to the kitchen"


def test_over_another_executive_the_plan_tells() -> None:
    tree, now, plan, _ = section()
    plan.planned(*sequential_steps(CompletePlan([dispatch(0, "ask", ("p", "dorm_room"))])), 0.0)
    plan.dispatched(dispatch(0, "ask", ("p", "dorm_room")), 1.0)
    plan.feedback(feedback(0, 1), 1.0)
    now.refresh()
    assert tree.get("now", "doing") == "asking at the dorm room"
    assert tree.get("now", "step") == "step 1 of 1"


def test_requests_are_remembered_from_asking_to_outcome() -> None:
    tree, now, _, reported = section()
    now.executor(executor(ExecutorStatus.RUNNING, request=REQUEST, goals=["(checked kitchen)"]), 10.0)
    now.executor(
        executor(
            ExecutorStatus.RUNNING,
            request=REQUEST,
            goals=["(checked kitchen)"],
            replans=1,
            reason="door shut",
        ),
        12.0,
    )
    result = ExecuteActionResult(
        status=GoalStatus(goal_id=GoalID(id=REQUEST)),
        result=ExecuteResult(outcome=ExecuteResult.ACTION_FAILED, reason="the door is shut"),
    )
    now.result(result, 14.0)
    assert reported.texts == [
        "“kitchen checked” asked for by /mission",
        "planning again: door shut",
        "“kitchen checked”: action failed after 4.0 s: the door is shut",
    ]
    assert tree.get("plan", "replans") == [{"at": 12.0, "reason": "door shut"}]
    assert tree.get("now", "last", "outcome") == "action failed"


def queue(*waiting: Tuple[str, str, int, bool]) -> GoalQueue:
    """Requests with goal, priority, and whether they were interrupted."""
    return GoalQueue(
        requests=[
            QueuedGoal(request=request, goals=[goal], priority=priority, interrupted=interrupted)
            for request, goal, priority, interrupted in waiting
        ]
    )


@pytest.mark.parametrize("waits", [False, True])
@pytest.mark.parametrize("runs", [False, True])
def test_an_interruption_is_reported_with_what_was_more_urgent(waits: bool, runs: bool) -> None:
    _, now, _, reported = section()
    mine, lesser = (REQUEST, "(checked kitchen)", 1, True), ("/c-1-1.0", "(checked hall)", 0, False)
    urgent = ("/merlin_monitor-1-13.0", "(robot_at main_door)", 5, False)
    now.queue(queue(), 0.0)
    now.executor(executor(ExecutorStatus.RUNNING, request=REQUEST, goals=[mine[1]], priority=1), 1.0)
    now.queue(queue(urgent, lesser), 2.0)
    if runs:  # of two topics, either may be heard first
        now.executor(executor(ExecutorStatus.RUNNING, request=urgent[0], goals=[urgent[1]], priority=5), 3.0)
    reported.clear()
    now.queue(queue(*([urgent] if waits else []), mine, lesser), 4.0)
    now.queue(queue(mine), 5.0)
    (event,) = reported
    assert (event.kind, event.at) == ("goal", 4.0)
    assert event.text == (
        "“kitchen checked” interrupted by the more urgent “robot at main door”, asked for by /merlin_monitor"
    )
    assert in_english(event.detail["said"]) == event.text


def test_what_was_interrupted_before_the_monitor_began_is_not_reported_as_new() -> None:
    _, now, _, reported = section()
    now.queue(queue((REQUEST, "(checked kitchen)", 1, True)), 1.0)
    assert reported == []
    now.queue(queue(), 2.0)
    now.queue(queue((REQUEST, "(checked kitchen)", 1, True)), 3.0)
    assert reported.texts == ["“kitchen checked” interrupted"]


def test_a_cancel_is_reported_with_its_client_and_what_it_cancels() -> None:
    _, now, _, reported = section()
    now.mission(MissionStatus(mission="mission 1", state=MissionStatus.RUNNING), 0.0, "/mission")
    now.executor(executor(ExecutorStatus.RUNNING, request=REQUEST, goals=["(checked kitchen)"]), 1.0)
    now.queue(queue(("/c-1-1.0", "(checked hall)", 0, False)), 2.0)
    reported.clear()
    for request, node in ((REQUEST, "/mission"), ("/c-1-1.0", "/c"), ("/gone-1-1.0", "/c"), ("", "/rosout")):
        now.cancel(GoalID(id=request), 3.0, node)
    assert reported.texts == [
        "mission 1 cancels “kitchen checked”",
        "/c cancels “hall checked”",
        "/c cancels a request",
        "/rosout cancels all requests",
    ]
    assert {event.kind for event in reported} == {"goal"}


def test_of_two_topics_either_may_be_heard_first() -> None:
    _, now, _, reported = section()
    now.mission(MissionStatus(mission="mission 1", state=MissionStatus.SUCCEEDED), 0.0, "/mission")
    reported.clear()
    now.executor(executor(ExecutorStatus.RUNNING, request=REQUEST, goals=["(checked kitchen)"]), 1.0)
    result = ExecuteActionResult(status=GoalStatus(goal_id=GoalID(id=REQUEST)))
    result.result.outcome = ExecuteResult.CANCELLED
    now.result(result, 2.0)
    now.cancel(GoalID(id=REQUEST), 2.0, "/mission")
    assert [reported.texts[0], reported.texts[2]] == [
        "“kitchen checked” asked for by mission 1",
        "mission 1 cancels “kitchen checked”",
    ]


def test_the_queue_names_who_waits() -> None:
    tree, now, _, _ = section()
    queued = QueuedGoal(request=REQUEST, goals=["(b)"], priority=5, interrupted=True)
    now.queue(GoalQueue(requests=[queued]), 1.0)
    (waiting,) = tree.get("queue", "waiting")
    assert (waiting["by"], waiting["priority"], waiting["interrupted"]) == ("/mission", 5, True)
    now.mission(MissionStatus(mission="Round", state=MissionStatus.RUNNING), 2.0, "/mission")
    other = QueuedGoal(request="/page-1-1.0", goals=["(c)"], by="Ana")
    now.queue(GoalQueue(requests=[queued, other]), 3.0)
    assert [waiting["by"] for waiting in tree.get("queue", "waiting")] == ["Round", "Ana"]


def test_a_request_that_waits_says_for_what() -> None:
    tree, now, _, _ = section()
    requests = [QueuedGoal(request=f"/c-{n}-1.0", goals=[f"({n})"]) for n in ("b", "c")]
    now.queue(GoalQueue(requests=requests), 1.0)

    def waits() -> List[str]:
        return [in_english(waiting["waits"]) for waiting in tree.get("queue", "waiting")]

    assert waits() == ["waits", "waits until “b” has ended"]
    now.executor(executor(ExecutorStatus.RUNNING, request=REQUEST, goals=["(a)"]), 2.0)
    assert waits() == ["waits until “a” has ended", "waits until “b” has ended"]
    now.executor(executor(ExecutorStatus.RUNNING, request=REQUEST, goals=["(a)"], paused=True), 3.0)
    assert waits()[0] == "waits until the robot is resumed"
    held = "the base is held by Ana since 14:03:07"
    now.executor(executor(ExecutorStatus.IDLE, paused=True, waits=held), 4.0)
    assert waits()[0] == f"waits: {held}"
    now.executor(executor(ExecutorStatus.IDLE, held="(b)"), 5.0)
    assert waits()[0] == "waits at a breakpoint"


def test_a_request_whose_time_has_not_come_waits_for_no_other_one() -> None:
    tree, now, _, _ = section()
    early = QueuedGoal(request="/c-b-1.0", goals=["(b)"], not_before=rospy.Time(100))
    now.executor(executor(ExecutorStatus.RUNNING, request=REQUEST, goals=["(a)"]), 2.0)
    now.queue(GoalQueue(requests=[early]), 2.0)
    for time, said in ((99.9, "waits"), (100.0, "waits until “a” has ended")):
        tree.set("meta", "time", time)
        now.refresh()
        assert in_english(tree.get("queue", "waiting")[0]["waits"]) == said


def test_an_urgent_request_waits_for_what_is_not_interrupted() -> None:
    tree, now, _, _ = section()
    why = "waits until (deliver cup) can be interrupted"
    urgent = QueuedGoal(request="/c-b-1.0", goals=["(b)"], priority=5, waits=why)
    urgent.survives, urgent.on_interrupt = True, 2
    now.executor(executor(ExecutorStatus.RUNNING, request=REQUEST, goals=["(a)"]), 2.0)
    now.queue(GoalQueue(requests=[urgent]), 2.0)
    shown = tree.get("queue", "waiting")[0]
    assert "can be interrupted" in in_english(shown["waits"]) and "deliver" in in_english(shown["waits"])
    assert shown["survives"] and shown["on_interrupt"] == "never"


@pytest.mark.parametrize(
    ("verb", "words"),
    [
        ("navigate", "navigating"),
        ("ask", "asking"),
        ("put", "putting"),
        ("see", "seeing"),
        ("check-table", "checking table"),
        ("tie", "tying"),
        ("load_tray", "loading tray"),
        ("go", "going"),
        ("serve", "serving"),
        ("pick_up", "picking up"),
        ("<b>", "<b>"),
        ("", ""),
        ("open", "opening"),
        ("listen", "listening"),
    ],
)
def test_verbs(verb: str, words: str) -> None:
    assert gerund(verb) == words


def test_lists_and_actions_in_words() -> None:
    assert listed([]) == "" and listed(["a"]) == "a" and listed(["a", "b", "c"]) == "a, b and c"
    assert listed(list("abcde")) == "a, b, c and 2 more"
    assert action_in_words("carry", [("what", "red_cup"), ("to", "table_1")]) == "carrying red cup to table 1"


def test_words_and_colour_of_one_truth_are_never_read_apart() -> None:
    tree, now, _, _ = section()
    states = (MissionStatus.RUNNING, MissionStatus.FAILED)
    feed, over = tree.subscribe(lambda: None), threading.Event()
    shown: Dict[str, Any] = {name: tree.get("now", name) for name in ("doing", "tone")}
    seen: Set[Tuple[Any, Any]] = set()

    def read() -> None:
        while not over.is_set():
            for path, value in feed.take().changes.as_list():
                if path[0] == "now" and path[1] in shown:
                    shown[path[1]] = value
            seen.add((shown["doing"], shown["tone"]))

    before = sys.getswitchinterval()
    reader = threading.Thread(target=read, name="reader")
    reader.start()
    sys.setswitchinterval(1e-6)
    try:
        for number in range(1000):
            now.mission(MissionStatus(mission="Round", state=states[number % 2]), float(number), "/mission")
            now.refresh()
    finally:
        sys.setswitchinterval(before)
        over.set()
        reader.join()
    assert len(seen) == len({doing for doing, _ in seen}), seen

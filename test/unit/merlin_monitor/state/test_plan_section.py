# SPDX-License-Identifier: Apache-2.0
"""The plan: its steps follow what is dispatched and answered, whatever the order of the messages."""

from itertools import permutations
from typing import Any, Dict, Iterator, List, Tuple

import pytest
from merlin_msgs.msg import DispatchStatus, ExecutorStatus, PlannerStatus
from messages import Reported, dispatch, ended, executor, feedback, running
from rosplan_dispatch_msgs.msg import CompletePlan, EsterelPlan, EsterelPlanEdge, EsterelPlanNode

from merlin_monitor.state.inbox import DirectInbox
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_monitor.state.plan_section import PlanSection
from merlin_monitor.state.plan_steps import graph_steps, sequential_steps
from merlin_monitor.state.state_tree import StateTree

PLAN = CompletePlan(
    [
        dispatch(0, "navigate", ("from", "hall"), ("to", "kitchen"), duration=25.0),
        dispatch(1, "ask", ("p", "kitchen"), duration=5.0, dispatch_time=25.0),
    ]
)


def section() -> Tuple[StateTree, PlanSection, Reported]:
    tree, reported = StateTree(), Reported()
    return tree, PlanSection(tree, reported), reported


def states(tree: StateTree) -> Dict[str, str]:
    return {key: step["state"] for key, step in tree.get("plan", "steps").items()}


def test_a_plan_is_carried_out() -> None:
    tree, plan, reported = section()
    plan.planned(*sequential_steps(PLAN), 10.0)
    assert tree.get("plan", "edges") == [["0", "1"]]
    plan.dispatched(dispatch(0, "navigate", ("from", "hall"), ("to", "kitchen"), plan=7), 11.0)
    assert states(tree) == {"0": "dispatched", "1": "waiting"}
    plan.feedback(feedback(0, 1, plan=7), 11.1)
    assert states(tree)["0"] == "running" and plan.current["text"] == "(navigate hall kitchen)"
    assert plan.step("(ask kitchen)") == 2
    plan.feedback(feedback(0, 2, plan=7), 21.0)
    plan.dispatched(dispatch(1, "ask", ("p", "kitchen"), plan=7), 21.1)
    plan.feedback(feedback(1, 10, "cancelled", plan=7), 22.0)
    assert states(tree) == {"0": "succeeded", "1": "cancelled"} and plan.current is None
    assert reported.texts == [
        "plan of 2 steps: navigating to kitchen and asking kitchen",
        "navigating to kitchen: succeeded after 10.0 s",
        "asking kitchen: cancelled after 0.9 s",
    ]
    assert reported[1].detail["began"] == 11.0 and reported[1].detail["ended"] == 21.0
    assert reported[1].detail["label"] == "(navigate hall kitchen)"


def test_a_step_that_is_reported_behind_the_end_of_its_request_is_not_dropped() -> None:
    tree, plan, _ = section()
    plan.planned(*sequential_steps(PLAN), 0.0)
    plan.request_ended()
    assert states(tree) == {"0": "dropped", "1": "dropped"}
    plan.feedback(feedback(0, 2, plan=7), 1.0)
    plan.dispatched(dispatch(0, "navigate", ("from", "hall"), ("to", "kitchen"), plan=7), 1.1)
    assert states(tree) == {"0": "succeeded", "1": "dropped"}


def test_failures_say_why() -> None:
    tree, plan, reported = section()
    plan.planned(*sequential_steps(PLAN), 0.0)
    plan.dispatched(dispatch(0, "navigate", ("from", "hall"), ("to", "kitchen")), 1.0)
    plan.feedback(feedback(0, 10, "the way is blocked"), 3.0)
    assert tree.get("plan", "steps", "0", "reason") == "the way is blocked"
    assert reported.texts[-1] == "navigating to kitchen: failed after 2.0 s: the way is blocked"


def test_latched_messages_of_an_earlier_plan_count_for_nothing() -> None:
    tree, plan, reported = section()
    plan.dispatched(dispatch(0, "navigate", ("from", "bath"), ("to", "hall"), plan=6), 1.0)
    plan.feedback(feedback(0, 2, plan=6), 1.0)
    plan.planned(*sequential_steps(PLAN), 2.0)
    assert states(tree) == {"0": "waiting", "1": "waiting"}
    plan.dispatched(dispatch(0, "cancel_action", plan=6), 2.0)
    plan.dispatched(dispatch(0, "navigate", ("from", "hall"), ("to", "kitchen"), plan=7), 3.0)
    plan.feedback(feedback(0, 2, plan=6), 3.1)
    assert states(tree)["0"] == "dispatched"


MIDDLE: Dict[str, Any] = {
    "plan": lambda plan: plan.planned(*sequential_steps(PLAN), 1.0),
    "status": lambda plan: plan.dispatcher(
        DispatchStatus(
            state=DispatchStatus.RUNNING, plan_id=7, running=[running(1, "ask", ("p", "kitchen"))]
        ),
        1.0,
    ),
    "dispatch": lambda plan: plan.dispatched(dispatch(1, "ask", ("p", "kitchen"), plan=7), 1.0),
    "first": lambda plan: plan.feedback(feedback(1, 1, plan=7), 1.0),
}


@pytest.mark.parametrize("order", permutations(MIDDLE))
def test_who_comes_in_the_middle_sees_what_runs(order: Tuple[str, ...]) -> None:
    tree, plan, _ = section()
    for name in order:
        MIDDLE[name](plan)
    assert states(tree)["1"] in ("dispatched", "running"), order


def graph(*pairs: Tuple[int, int]) -> Any:
    """Three actions: 1 and 2 are start and end of the first, 3 and 4 of the second, and so on."""
    nodes = [EsterelPlanNode(node_type=EsterelPlanNode.PLAN_START, node_id=0)]
    for number, name in enumerate("abc"):
        action = dispatch(number, name, dispatch_time=float(number))
        nodes += [
            EsterelPlanNode(node_type=end, node_id=1 + 2 * number + end, action=action) for end in (0, 1)
        ]
    edges = [EsterelPlanEdge(source_ids=[a], sink_ids=[b]) for a, b in pairs]
    return graph_steps(EsterelPlan(nodes, edges))


def test_a_graph_keeps_the_edges_that_matter() -> None:
    steps, order = graph((0, 1), (1, 2), (2, 3), (3, 4), (4, 5), (2, 5), (1, 5), (99, 5))
    assert [step.text for step in steps] == ["(a)", "(b)", "(c)"]
    assert order == [(0, 1), (1, 2)], "a before c follows from the others"


def test_a_graph_says_which_edges_go_not_from_an_end_to_a_start() -> None:
    assert graph((1, 3), (2, 6))[1] == [(0, 1, "start"), (0, 2, "end")]
    assert graph((1, 3), (2, 3), (2, 4))[1] == [(0, 1)], "the end of a has to come first all the same"


def test_a_graph_with_a_cycle_is_still_drawn() -> None:
    nodes = [EsterelPlanNode(node_type=0, node_id=n, action=dispatch(n, "x")) for n in range(3)]
    edges = [EsterelPlanEdge(source_ids=[n], sink_ids=[(n + 1) % 3]) for n in range(3)]
    assert len(graph_steps(EsterelPlan(nodes, edges))[1]) == 3


def test_the_planner_says_why_it_failed() -> None:
    tree, plan, reported = section()
    plan.planner(PlannerStatus(state=PlannerStatus.IDLE), 0.0)
    plan.planner(
        PlannerStatus(state=PlannerStatus.UNSOLVABLE, planner="kairos", seconds=0.5, reason="no door"), 1.0
    )
    assert tree.get("plan", "planner", "state") == "unsolvable"
    assert reported.texts == ["kairos: unsolvable after 0.50 s: no door"]
    plan.replanned("(navigate hall kitchen) failed", 2.0)
    assert tree.get("plan", "replans") == [{"at": 2.0, "reason": "(navigate hall kitchen) failed"}]


def test_a_dispatch_that_overtakes_its_plan_counts() -> None:
    tree, plan, _ = section()
    plan.planned(*sequential_steps(CompletePlan([dispatch(0, "ask", ("p", "hall"))])), 5.0)
    begun = dispatch(0, "navigate", ("from", "hall"), ("to", "kitchen"), plan=8)
    plan.dispatched(begun, 10.0)
    plan.feedback(feedback(0, 2, plan=8), 10.1)
    plan.planned(*sequential_steps(PLAN), 10.2)
    assert states(tree) == {"0": "succeeded", "1": "waiting"}
    # Of long ago, it belongs to another plan with the same step.
    plan.planned(*sequential_steps(CompletePlan([dispatch(0, "ask", ("p", "hall"))])), 20.0)
    plan.dispatched(begun, 21.0)
    plan.planned(*sequential_steps(PLAN), 30.0)
    assert states(tree) == {"0": "waiting", "1": "waiting"}


@pytest.mark.parametrize("heard", [*permutations(["dispatch", "status"]), ("dispatch",), ("status",)])
@pytest.mark.parametrize("answer", [1, 2])
def test_a_plan_like_the_one_before_counts_though_its_dispatch_overtakes_it(
    heard: Tuple[str, ...], answer: int
) -> None:
    tree, plan, _ = section()
    drive = ("from", "hall"), ("to", "kitchen")
    plan.planned(*sequential_steps(PLAN), 10.0)
    plan.dispatched(dispatch(0, "navigate", *drive, plan=7), 11.0)
    plan.dispatcher(DispatchStatus(state=DispatchStatus.RUNNING, plan_id=7), 11.0)
    plan.feedback(feedback(0, 10, "cancelled", plan=7), 12.0)
    plan.dispatcher(DispatchStatus(plan_id=7), 12.0)
    begun = DispatchStatus(state=DispatchStatus.RUNNING, plan_id=8, running=[running(0, "navigate", *drive)])
    for what in heard:
        if what == "dispatch":
            plan.dispatched(dispatch(0, "navigate", *drive, plan=8), 13.0)
        else:
            plan.dispatcher(begun, 13.0)
    plan.feedback(feedback(0, answer, plan=8), 13.1)
    assert states(tree)["0"] == "cancelled"
    plan.planned(*sequential_steps(PLAN), 13.2)
    if "dispatch" not in heard:
        plan.dispatched(dispatch(0, "navigate", *drive, plan=8), 13.3)
    assert states(tree) == {"0": "succeeded" if answer == 2 else "running", "1": "waiting"}
    plan.planned(*sequential_steps(PLAN), 14.0)  # of which nothing has begun
    assert states(tree) == {"0": "waiting", "1": "waiting"}


DRIVE = ("from", "hall"), ("to", "kitchen")
FURTHER = CompletePlan([dispatch(1, "navigate", *DRIVE), dispatch(2, "ask", ("p", "kitchen"))])


def hear_status(plan: PlanSection) -> None:
    plan.dispatcher(DispatchStatus(state=DispatchStatus.RUNNING, plan_id=7), 10.5)
    drives = [running(1, "navigate", *DRIVE)]
    plan.dispatcher(DispatchStatus(state=DispatchStatus.RUNNING, plan_id=7, running=drives), 10.6)
    plan.dispatcher(DispatchStatus(plan_id=7), 12.0)


#: What a monitor hears at 15 s that hangs from 10 s on: only the dispatcher's status has a stamp.
STALL: Dict[str, Any] = {
    "plan": lambda plan: plan.planned(*sequential_steps(FURTHER), 15.0),
    "dispatch": lambda plan: plan.dispatched(dispatch(1, "navigate", *DRIVE, plan=7), 15.0),
    "feedback": lambda plan: plan.feedback(feedback(1, 10, "blocked", plan=7), 15.0),
    "status": hear_status,
}


@pytest.mark.parametrize("order", permutations(STALL))
def test_a_plan_that_begins_and_ends_while_the_monitor_hangs(order: Tuple[str, ...]) -> None:
    tree, plan, reported = section()
    plan.planned(*sequential_steps(CompletePlan([dispatch(0, "ask", ("p", "hall"))])), 1.0)
    plan.dispatched(dispatch(0, "ask", ("p", "hall"), plan=6), 1.1)
    plan.feedback(feedback(0, 2, plan=6), 2.0)
    plan.dispatcher(DispatchStatus(plan_id=6), 2.0)
    for name in order:
        STALL[name](plan)
    plan.request_ended()
    assert states(tree) == {"1": "failed", "2": "dropped"}
    assert any(text.startswith("navigating to kitchen: failed") for text in reported.texts)


def test_what_goes_on_is_shown_in_front_of_the_plan_that_follows() -> None:
    tree, plan, _ = section()
    drive = ("from", "hall"), ("to", "kitchen")
    plan.planned(*sequential_steps(PLAN), 10.0)
    plan.dispatched(dispatch(0, "navigate", *drive, plan=7), 11.0)
    further = CompletePlan([dispatch(2, "ask", ("p", "bath")), dispatch(3, "ask", ("p", "hall"))])
    plan.planned(*sequential_steps(further), 12.0)
    goes_on = running(0, "navigate", *drive)
    for _ in range(2):
        plan.dispatcher(DispatchStatus(state=DispatchStatus.RUNNING, plan_id=7, running=[goes_on]), 12.1)
    assert tree.get("plan", "order") == ["0", "2", "3"]
    assert states(tree) == {"0": "dispatched", "2": "waiting", "3": "waiting"}
    assert tree.get("plan", "steps", "0", "began") == 11.0
    plan.feedback(feedback(0, 2, plan=7), 20.0)
    plan.dispatched(dispatch(2, "ask", ("p", "bath"), plan=7), 20.1)
    assert states(tree) == {"0": "succeeded", "2": "dispatched", "3": "waiting"}
    assert plan.step("(ask bath)") == 2 and plan.count == 3


def interleaved(*topics: List[Any]) -> Iterator[List[Any]]:
    """All orders in which the messages of several topics can be read; those of one keep theirs."""
    if not any(topics):
        yield []
    for topic in topics:
        rest = [each[1:] if each is topic else each for each in topics]
        yield from ([topic[0], *order] for order in (interleaved(*rest) if topic else ()))


@pytest.mark.parametrize(
    "first", [PLAN, CompletePlan([dispatch(0, "ask", ("p", "kitchen"))])], ids=["same", "other"]
)
@pytest.mark.parametrize("count", [2, 3])
def test_plans_that_follow_each_other_while_the_monitor_hangs(first: CompletePlan, count: int) -> None:
    """All but the last one fail; what is shown is what runs, in all orders of the topics."""
    topics: List[List[Tuple[str, Any]]] = [[], [], []]
    for number, plans in enumerate([first, *[PLAN] * (count - 1)]):
        begun = dispatch(0, plans.plan[0].name, plan=7 + number)
        begun.parameters = plans.plan[0].parameters
        answer = (1, "") if number == count - 1 else (10, "blocked")
        topics[0].append(("planned", sequential_steps(plans)))
        topics[1].append(("dispatched", (begun,)))
        topics[2].append(("feedback", (feedback(0, *answer, plan=7 + number),)))
    for order in interleaved(*topics):
        tree, plan, _ = section()
        plan.planned(*sequential_steps(CompletePlan([dispatch(0, "ask", ("p", "hall"))])), 1.0)
        plan.dispatched(dispatch(0, "ask", ("p", "hall"), plan=6), 1.1)
        for topic, message in order:
            getattr(plan, topic)(*message, 15.0)
        assert states(tree) == {"0": "running", "1": "waiting"}, [topic for topic, _ in order]


def test_an_answer_counts_for_the_dispatch_that_has_begun_its_step() -> None:
    tree, plan, _ = section()
    plan.planned(*sequential_steps(PLAN), 15.0)
    plan.dispatched(dispatch(0, "navigate", *DRIVE, plan=8), 15.0)
    before = [running(0, "ask", ("p", "hall"))]
    plan.dispatcher(DispatchStatus(state=DispatchStatus.RUNNING, plan_id=7, running=before), 10.6)
    plan.feedback(feedback(0, 10, "blocked", plan=7), 15.0)
    assert states(tree)["0"] == "dispatched"
    plan.feedback(feedback(0, 1, plan=8), 15.0)
    assert states(tree)["0"] == "running"


def test_a_plan_is_not_dropped_with_the_request_before_its_own() -> None:
    model = MonitorModel(DirectInbox())
    tree = model.tree
    model.now.executor(executor(ExecutorStatus.RUNNING, request="first", steps_total=1), 1.0)
    model.planned(*sequential_steps(PLAN), 15.0)
    model.now.result(ended("first", "succeeded"), 12.0)
    model.now.executor(executor(ExecutorStatus.RUNNING, request="first", steps_total=2), 11.0)
    assert states(tree) == {"0": "dropped", "1": "dropped"}, "as far as is known it is that of the first"
    model.now.executor(executor(ExecutorStatus.RUNNING, request="second"), 13.0)
    model.now.executor(executor(ExecutorStatus.RUNNING, request="second", steps_total=2), 14.0)
    assert states(tree) == {"0": "waiting", "1": "waiting"}
    model.now.result(ended("second", "cancelled"), 16.0)
    assert states(tree) == {"0": "dropped", "1": "dropped"}


def test_nothing_ends_before_its_begin_when_simulated_time_is_set_back() -> None:
    model, reported = MonitorModel(DirectInbox()), Reported()
    model.on_event = reported
    model.planned(*sequential_steps(PLAN), 500.0)
    model.now.executor(executor(ExecutorStatus.RUNNING, request="/a-1", goals=["(a)"]), 500.0)
    model.plan.dispatched(dispatch(0, "navigate", ("from", "hall"), ("to", "kitchen"), plan=7), 500.0)
    model.plan.feedback(feedback(0, 2, plan=7), 12.0)
    model.now.result(ended("/a-1", "succeeded"), 12.5)
    assert reported.texts[-2:] == [
        "navigating to kitchen: succeeded after 0.0 s",
        "“a”: succeeded after 0.0 s",
    ]
    assert [(each.detail["began"], each.detail["ended"]) for each in reported[-2:]] == [
        (12.0, 12.0),
        (12.5, 12.5),
    ]
    (shown,) = model.tree.get("queue", "ended")
    assert shown["real"] == [12.5, 12.5]

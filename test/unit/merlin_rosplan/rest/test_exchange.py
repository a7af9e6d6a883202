# SPDX-License-Identifier: Apache-2.0
"""A plan that takes the place of the rest of another: what goes on, what stops, and what follows."""

import dataclasses

import pytest
from dispatch_world import WORK, Run, World, actions, parallel

from merlin_pddl.plan_text import PlanStep
from merlin_rosplan.dispatch.dispatch_environment import DispatchState, Exchange, FeedbackStatus, Tick
from merlin_rosplan.dispatch.dispatch_graph import SequentialSchedule
from merlin_rosplan.dispatch.dispatch_schedule import Ongoing, PlanError, PlannedAction
from merlin_rosplan.dispatch.operator_model import ActionModel, Conditions, PlanTerm, TimedEffects
from merlin_rosplan.dispatch.plan_graph_builder import build_graph
from merlin_rosplan.rest.exchange import continued_graph, continued_list
from merlin_test import LONG


def further(*objects, first=10):
    """The actions of another plan, with ids of their own."""
    return [
        dataclasses.replace(action, id=first + number, parameters=(("x", name),))
        for number, (name, action) in enumerate(zip(objects, actions(*["work"] * len(objects))))
    ]


def wish(plan, *keep, known=None):
    return Exchange(
        frozenset(keep), lambda ongoing: (SequentialSchedule(continued_list(plan, ongoing)), None), known
    )


def exchanged(run, plan, *keep, known=None):
    asked = wish(plan, *keep, known=known)
    run.dispatch.exchange(asked)
    assert asked.ended.wait(LONG)
    return asked.refusal


def begun(*names):
    """A dispatch whose first action runs."""
    world = World(WORK)
    run = Run(world, SequentialSchedule(actions(*names)))
    world.wait("action", 0)
    run.feedback(0, FeedbackStatus.ENABLED)
    return world, run


def succeed(world, run, number):
    world.wait("action", number)
    run.feedback(number, FeedbackStatus.ENABLED)
    run.feedback(number, FeedbackStatus.SUCCEEDED)


def sent(world):
    return [entry for entry in world.published if not entry[0].startswith("own")]


def test_what_runs_goes_on_and_the_new_steps_follow():
    world, run = begun("work", "work")
    assert exchanged(run, further("a", "b"), 0) == ""
    assert [str(action) for action in world.reports[-1].running] == ["(work o0)"]
    assert world.reports[-1].steps_total == 3
    run.feedback(0, FeedbackStatus.SUCCEEDED)
    succeed(world, run, 10)
    succeed(world, run, 11)
    report = run.report()
    assert report.success and report.steps_done == 3
    assert sent(world) == [("action", 0), ("action", 10), ("action", 11), ("tombstone", 11)]


def test_a_plan_without_steps_ends_with_what_goes_on():
    world, run = begun("work", "work")
    assert exchanged(run, [], 0) == ""
    run.feedback(0, FeedbackStatus.SUCCEEDED)
    assert run.report().success and sent(world) == [("action", 0), ("tombstone", 0)]


def test_what_is_not_named_is_stopped_before_the_new_plan_begins():
    world, run = begun("work", "work")
    assert exchanged(run, further("a")) == ""
    world.wait("cancel", 0)
    assert ("action", 10) not in world.published
    run.feedback(0, FeedbackStatus.FAILED, reason="cancelled")
    succeed(world, run, 10)
    report = run.report()
    assert report.success and report.steps_done == 1
    assert sent(world) == [("action", 0), ("cancel", 0), ("action", 10), ("tombstone", 10)]


def test_an_action_that_the_new_plan_begins_with_goes_on_as_its_first_step():
    world, run = begun("work", "work")
    assert exchanged(run, further("O0", "b")) == ""
    run.feedback(0, FeedbackStatus.SUCCEEDED)
    succeed(world, run, 11)
    report = run.report()
    assert report.success and report.steps_done == 2
    assert sent(world) == [("action", 0), ("action", 11), ("tombstone", 11)]


@pytest.mark.parametrize("plan, goes_on", [("o1 b", True), ("b o1", False), ("b", False)])
def test_a_plan_has_to_begin_with_what_has_begun_since_it_was_made(plan, goes_on):
    world, run = begun("work", "work")
    run.feedback(0, FeedbackStatus.SUCCEEDED)
    world.wait("action", 1)
    run.feedback(1, FeedbackStatus.ENABLED)
    refused = exchanged(run, further(*plan.split()), 0, known=frozenset({0}))
    assert ("(work o1) has begun since it was made" in refused) is not goes_on
    run.feedback(1, FeedbackStatus.SUCCEEDED)
    if goes_on:
        succeed(world, run, 11)
    assert run.report().success
    assert [kind for kind, _ in sent(world)] == ["action"] * (2 + goes_on) + ["tombstone"]


def test_a_plan_does_not_repeat_what_has_begun_and_ended_since_it_was_made():
    world, run = begun("work", "work", "work")
    run.feedback(0, FeedbackStatus.SUCCEEDED)
    succeed(world, run, 1)
    world.wait("action", 2)
    run.feedback(2, FeedbackStatus.ENABLED)
    refused = exchanged(run, further("o2"), 0, known=frozenset({0}))
    assert refused == "action 1 has begun and ended since the plan was made"
    assert exchanged(run, further("o2"), known=frozenset({0, 1})) == ""
    run.feedback(2, FeedbackStatus.SUCCEEDED)
    assert run.report().success and ("cancel", 2) not in sent(world)


@pytest.mark.parametrize("begun_since, goes_on", [("x", True), ("y", False), ("z", True)])
def test_what_a_plan_begins_with_is_what_waits_for_no_other_step_of_it(begun_since, goes_on):
    """Whatever its place in the list: y waits for the hand that x has, and z for nothing."""
    free = PlanTerm("free", ("h",))
    model = ActionModel(
        "work",
        ("h", "x"),
        at_start=Conditions(positive=(free,)),
        start_effects=TimedEffects(delete=(free,)),
        end_effects=TimedEffects(add=(free,)),
    )

    def operator(action):
        return model.ground(dict(action.parameters))

    listed = [("left", "x", 0.0), ("left", "y", 1.1), ("right", "z", 5.0)]
    plan = [
        PlannedAction(10 + number, "work", (("h", hand), ("x", thing)), 1.0, time)
        for number, (hand, thing, time) in enumerate(listed)
    ]
    steps = [PlanStep(time, "work", (hand, thing), 1.0) for hand, thing, time in listed]
    graph = build_graph(steps, [operator(action) for action in plan])
    running = next(
        dataclasses.replace(action, id=3)
        for action in plan
        if begun_since in dict(action.parameters).values()
    )
    ongoing = Ongoing(others=(running,), used=frozenset({3}), new=frozenset({3}))
    if goes_on:
        assert running in continued_graph(graph, plan, ongoing, operator)
        return
    with pytest.raises(PlanError, match="has begun since it was made"):
        continued_graph(graph, plan, ongoing, operator)


def test_a_step_waits_for_what_goes_on_where_only_a_constraint_needs_it():
    model = ActionModel(
        "pass",
        ("r",),
        start_effects=TimedEffects(add=(PlanTerm("in", ("r",)),)),
        end_effects=TimedEffects(delete=(PlanTerm("in", ("r",)),)),
        constraints=(frozenset({("in", "r1"), ("in", "r2")}),),
    )

    def operator(action):
        return model.ground(dict(action.parameters))

    kept, *plan = [
        PlannedAction(3 + number, "pass", (("r", robot),), 1.0)
        for number, robot in enumerate(("r1", "r2", "r3"))
    ]
    steps = [PlanStep(0.0, "pass", (robot,), 1.0) for robot in ("r2", "r3")]
    graph = build_graph(steps, [operator(action) for action in plan])
    continued_graph(graph, plan, Ongoing(kept=(kept,), used=frozenset({3})), operator)
    ends = {node.id for node in graph.nodes if node.name == "pass_end" and node.action == 2}
    waiting = {edge.sink for edge in graph.edges if edge.source in ends}
    assert 1 in waiting and 3 not in waiting


def test_an_action_that_does_not_stop_fails_the_plan():
    world = World(WORK)
    run = Run(world, SequentialSchedule(actions("work", "work")), cancel=0.05)
    world.wait("action", 0)
    assert exchanged(run, further("a")) == ""
    report = run.report()
    assert report.state is DispatchState.FAILED and ("action", 10) not in world.published
    assert report.reason.startswith("(work o0) was cancelled and did not stop within 0.05 s")
    assert [str(action) for action in report.unanswered] == ["(work o0)"]


def test_an_action_whose_interface_says_that_it_does_not_stop_fails_the_plan():
    world, run = begun("work", "work")
    assert exchanged(run, further("a")) == ""
    run.feedback(0, FeedbackStatus.FAILED, reason="it does not stop", unstopped=True)
    report = run.report()
    assert report.state is DispatchState.FAILED and ("action", 10) not in world.published
    assert report.reason == "(work o0) was cancelled and did not stop"


@pytest.mark.parametrize(
    "answer, state, why",
    [
        ({}, DispatchState.SUCCEEDED, "the last action had ended when the cancel came through"),
        ({"unstopped": True}, DispatchState.CANCELLED, "not wanted; (work o0) did not stop"),
        (None, DispatchState.CANCELLED, "not wanted; no answer to the cancel from (work o0)"),
    ],
)
def test_a_cancel_behind_the_last_step_is_a_success_once_what_the_plan_does_without_has_stopped(
    answer, state, why
):
    world = World(WORK)
    run = Run(world, SequentialSchedule(actions("work", "work")))
    world.wait("action", 0)
    assert exchanged(run, []) == ""
    run.dispatch.cancel("not wanted")
    with world.changed_event:
        assert world.changed_event.wait_for(lambda: world.reports[-1].state is DispatchState.CANCELLING, LONG)
    if answer is None:  # its interface dies
        world.silences["work"] = 2 * LONG
        run.dispatch.put(Tick())
    else:
        run.feedback(0, FeedbackStatus.FAILED, reason="cancelled", **answer)
    report = run.report()
    assert (report.state, report.reason) == (state, why)


def test_an_action_that_goes_on_and_fails_fails_the_new_plan():
    world, run = begun("work", "work")
    assert exchanged(run, further("a"), 0) == ""
    run.feedback(0, FeedbackStatus.FAILED, reason="stuck")
    report = run.report()
    assert report.state is DispatchState.FAILED and report.reason == "(work o0) failed: stuck"
    assert ("action", 10) not in world.published


def test_one_that_has_succeeded_meanwhile_does_no_harm():
    world, run = begun("work", "work")
    run.feedback(0, FeedbackStatus.SUCCEEDED)
    world.wait("action", 1)
    run.feedback(1, FeedbackStatus.ENABLED)
    assert exchanged(run, further("a"), 0, 1) == ""
    run.feedback(1, FeedbackStatus.SUCCEEDED)
    succeed(world, run, 10)
    assert run.report().success


@pytest.mark.parametrize(
    "plan, keep, reason",
    [
        (further("a"), (0, 5), "action 5, which neither runs nor has succeeded"),
        (further("a", first=1), (0,), "the ids of its actions were used before"),
        (further("a", first=0), (0,), "the ids of its actions were used before"),
    ],
)
def test_a_refused_plan_changes_nothing(plan, keep, reason):
    world, run = begun("work", "work")
    assert reason in exchanged(run, plan, *keep)
    run.feedback(0, FeedbackStatus.SUCCEEDED)
    succeed(world, run, 1)
    assert run.report().success
    assert sent(world) == [("action", 0), ("action", 1), ("tombstone", 1)]


def test_a_plan_that_cannot_be_looked_at_is_refused():
    def make(_):
        raise PlanError("there is an unknown operator")

    _, run = begun("work")
    asked = Exchange(frozenset({0}), make)
    run.dispatch.exchange(asked)
    assert asked.ended.wait(LONG) and asked.refusal == "there is an unknown operator"
    run.feedback(0, FeedbackStatus.SUCCEEDED)
    assert run.report().success


@pytest.mark.parametrize("first", ["cancel", "exchange"])
def test_a_cancel_stops_what_goes_on(first):
    world, run = begun("work", "work")
    asked = wish(further("a"), 0)
    calls = [run.dispatch.cancel, lambda: run.dispatch.exchange(asked)]
    for call in calls if first == "cancel" else calls[::-1]:
        call()
    world.wait("cancel", 0)
    run.feedback(0, FeedbackStatus.FAILED, reason="cancelled")
    report = run.report()
    assert report.state is DispatchState.CANCELLED and report.running == ()
    assert asked.ended.wait(LONG) and bool(asked.refusal) == (first == "cancel")
    assert ("action", 10) not in world.published


def test_a_plan_that_comes_behind_the_end_is_refused():
    _, run = begun("work")
    run.feedback(0, FeedbackStatus.SUCCEEDED)
    assert run.report().success
    assert exchanged(run, further("a"), 0) == "the plan ends, or has ended"


def test_a_wish_that_was_taken_back_is_not_carried_out():
    world, run = begun("work", "work")
    asked = wish(further("a"), 0)
    assert asked.take_back() and not asked.take_back()
    run.dispatch.exchange(asked)
    run.feedback(0, FeedbackStatus.SUCCEEDED)
    succeed(world, run, 1)
    assert run.report().success and not asked.ended.is_set()


def test_a_robot_that_has_left_ends_the_plan_all_the_same():
    world = World(WORK)
    run = Run(world, parallel(["work", "work"]))
    world.wait("action", 1)
    run.feedback(0, FeedbackStatus.ENABLED)
    run.feedback(1, FeedbackStatus.ENABLED)
    run.feedback(0, FeedbackStatus.FAILED, reason="away", robot="ann")
    assert exchanged(run, further("a"), 1) == "(work o0) failed: away"
    run.feedback(1, FeedbackStatus.SUCCEEDED)
    assert run.report().state is DispatchState.FAILED


def test_nothing_running_is_nothing_to_be_put_in_front():
    plan = further("a", "b")
    assert continued_list(plan, Ongoing()) == plan

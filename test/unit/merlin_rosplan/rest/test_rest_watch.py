# SPDX-License-Identifier: Apache-2.0
"""The rest of a plan in a world that changes: what is noticed, what is not needed any more."""

import pytest
from rest_world import RestWorld, planned

from merlin_pddl.knowledge import FunctionValue, Instance
from merlin_pddl.plan_text import OUTDATED
from merlin_rosplan.dispatch.dispatch_environment import DispatchError
from merlin_rosplan.dispatch.dispatch_graph import SequentialSchedule
from merlin_rosplan.rest.rest_watch import PlanWatch

DOMAIN = """(define (domain house) (:requirements :adl :typing :durative-actions :numeric-fluents
    :derived-predicates)
  (:types room door item)
  (:constants anywhere - room)
  (:predicates (at ?r - room) (joins ?d - door ?a ?b - room) (open ?d - door) (checked ?r - room) (calm)
    (has ?i - item) (lies ?i - item ?r - room) (free) (wet ?r - room) (reachable ?r - room))
  (:functions (battery) (steps))
  (:derived (reachable ?r - room) (exists (?d - door) (and (open ?d) (joins ?d ?r ?r))))
  (:durative-action drive :parameters (?d - door ?a ?b - room) :duration (= ?duration 10)
    :condition (and (at start (at ?a)) (at start (joins ?d ?a ?b)) (at start (open ?d))
      (at start (>= (battery) 20)))
    :effect (and (at start (not (at ?a))) (at end (at ?b)) (at end (increase (steps) 1))))
  (:durative-action check :parameters (?r - room) :duration (= ?duration 5)
    :condition (and (over all (at ?r)) (over all (calm)))
    :effect (at end (checked ?r)))
  (:action unlock :parameters (?d - door) :precondition (not (open ?d)) :effect (open ?d))
  (:action grasp :parameters (?i - item ?r - room)
    :precondition (and (at ?r) (lies ?i ?r) (free)) :effect (and (has ?i) (not (lies ?i ?r)) (not (free))))
  (:action place :parameters (?i - item ?r - room)
    :precondition (and (at ?r) (has ?i)) :effect (and (lies ?i ?r) (not (has ?i)) (free)))
  (:action mop :parameters (?r - room) :effect (forall (?o - room) (when (wet ?o) (not (wet ?o)))))
  (:action rest :parameters () :precondition (forall (?r - room) (not (wet ?r))) :effect (calm))
  (:action charge :parameters () :effect (assign (battery) 100))
  (:action look :parameters (?r - room) :precondition (reachable ?r) :effect (checked ?r)))"""
INIT = """(at base) (joins d1 base hall) (joins d2 hall kitchen) (joins d3 base base) (open d1) (open d2)
  (open d3) (calm) (free) (lies cup kitchen) (= (battery) 50) (= (steps) 0)"""
TOUR = ["(drive d1 base hall)", "(check hall)", "(drive d2 hall kitchen)", "(check kitchen)"]


def world_of(*texts, goal="(and (checked hall) (checked kitchen))", init=INIT):
    problem = f"""(define (problem p) (:domain house)
      (:objects base hall kitchen - room d1 d2 d3 - door cup - item) (:init {init}) (:goal {goal}))"""
    return RestWorld(DOMAIN, problem, planned(*texts))


@pytest.fixture
def tour():
    world = world_of(*TOUR)
    world.start(0)
    return world


def test_a_door_that_closes_is_noticed_at_once_and_named(tour):
    assert tour.watch.look() is None
    tour.make("(not (open d2))")
    verdict = tour.watch.look()
    assert verdict.reason == (
        f"{OUTDATED}step 3, (drive d2 hall kitchen), cannot be carried out: (open d2) does not hold"
    )
    assert verdict.action is tour.actions[2] and not verdict.achieved


def test_what_opens_again_before_a_look_is_nothing(tour):
    tour.make("(not (open d2))")
    tour.make("(open d2)")
    assert tour.watch.look() is None


def test_the_same_verdict_is_not_given_twice_without_a_change(tour):
    tour.make("(not (open d2))")
    assert tour.watch.look() is not None
    assert tour.watch.look() is None


def test_a_change_that_no_step_needs_is_nothing(tour):
    tour.make("(not (open d3))", "(wet hall)", "(not (open d1))")  # the drive through d1 has begun
    assert tour.watch.look() is None


def test_what_an_earlier_step_brings_may_go():
    world = world_of("(unlock d2)", *TOUR, init=INIT.replace("(open d2)", ""))
    world.make("(wet base)", "(not (joins d3 base base))")
    assert world.watch.look() is None
    world.start(0)
    world.make("(open d3)", "(not (open d3))")
    assert world.watch.look() is None


@pytest.mark.parametrize("answered_first", [True, False])
def test_the_effects_of_the_plan_itself_are_no_news(tour, answered_first):
    for number in range(4):
        if number:
            tour.start(number, while_running=["(not (calm))"] if number == 2 else [])
        assert tour.watch.look() is None
        if answered_first:  # what has changed is heard after the answer
            tour.watch.ended(number)
            tour.finish(number)
        else:
            tour.finish(number)
            assert tour.watch.look() is None
            tour.watch.ended(number)
        assert tour.watch.look() is None and not tour.watch.skipped


def test_what_holds_only_while_an_action_runs_is_judged_at_its_end(tour):
    tour.end(0)
    tour.start(1)
    tour.end(1)
    tour.start(2, while_running=["(not (calm))", "(at anywhere)"])
    assert tour.watch.look() is None
    tour.make("(not (calm))")  # changes nothing now
    tour.finish(2)
    tour.make("(not (calm))")
    tour.watch.ended(2)
    assert "step 4, (check kitchen), cannot be carried out: (calm) does not hold" in tour.watch.look().reason


def test_a_value_counts_where_no_step_changes_it(tour):
    with tour.store.transaction() as change:
        change.add(_value("battery", 10))
    assert "step 3" in tour.watch.look().reason and "a comparison of battery is false" in _last(tour)
    charged = world_of("(charge)", *TOUR)
    with charged.store.transaction() as change:
        change.add(_value("battery", 10))
    assert charged.watch.look() is None


def _value(name, value):
    return FunctionValue(name, (), float(value))


def _last(world):
    with world.store.transaction() as change:
        change.add(_value("battery", 11))
    return world.watch.look().reason


def test_a_robot_that_leaves_does_not_end_the_plan_of_the_others(tour):
    tour.robot_of = lambda action, unmet: "ann"
    tour.make("(not (open d2))")
    assert tour.watch.look() is None


def test_an_object_that_is_removed_is_noticed():
    world = world_of(*TOUR)
    world.start(0)
    with world.store.transaction() as change:
        change.remove(Instance("door", "d2"))
    assert "step 3, (drive d2 hall kitchen), cannot be carried out: there is no object d2" in (
        world.watch.look().reason
    )


def test_conditional_and_quantified_effects_and_conditions_give_no_false_alarm():
    world = world_of("(mop hall)", "(rest)", goal="(calm)", init=INIT.replace("(calm)", ""))
    world.make("(wet kitchen)")
    assert world.watch.look() is None  # the mop may dry it
    world.start(0)
    world.end(0)
    assert world.watch.look() is None
    world.make("(wet kitchen)")
    assert "step 2, (rest), cannot be carried out" in world.watch.look().reason


def test_a_derived_condition_is_judged():
    world = world_of("(look base)", goal="(checked base)")
    world.make("(not (open d3))")
    assert "(reachable base) does not hold" in world.watch.look().reason


def test_what_a_timed_change_may_bring_is_waited_for(tour):
    tour.timed = {"open"}
    tour.make("(not (open d2))")
    assert tour.watch.look() is None
    tour.timed = set()  # it was taken back
    tour.make("(wet hall)")
    assert "(open d2) does not hold" in tour.watch.look().reason


# --- what came true by itself -----------------------------------------------------------------------------


def test_a_step_that_came_true_by_itself_is_skipped():
    world = world_of("(unlock d2)", *TOUR, init=INIT.replace("(open d2)", ""))
    world.make("(open d2)")  # the step cannot be carried out any more, and need not be
    assert world.watch.look() is None
    assert set(world.watch.skipped) == {0}
    world.make("(not (open d2))")
    assert world.watch.look() is None
    assert set(world.watch.skipped) == set()


def test_with_a_goal_that_came_true_all_that_served_it_is_skipped(tour):
    tour.make("(checked kitchen)")
    assert tour.watch.look() is None
    assert set(tour.watch.skipped) == {2, 3}


def test_a_step_of_which_others_need_more_stays(tour):
    tour.make("(checked hall)")
    assert tour.watch.look() is None
    assert set(tour.watch.skipped) == {1}, "the drive to the kitchen begins in the hall"


def test_steps_that_belong_together_are_skipped_together():
    world = world_of(
        "(drive d1 base hall)",
        "(drive d2 hall kitchen)",
        "(grasp cup kitchen)",
        "(drive d2 kitchen hall)",
        "(place cup hall)",
        "(check hall)",
        goal="(and (lies cup hall) (checked hall))",
        init=INIT + "(joins d2 kitchen hall)",
    )
    world.start(0)
    world.make("(not (lies cup kitchen))", "(lies cup hall)")
    assert world.watch.look() is None
    assert set(world.watch.skipped) == {2, 4}, "the way there and back needs a new plan to be saved"


def test_without_goals_no_step_is_skipped():
    world = world_of(*TOUR, goal="(and)")
    world.start(0)
    world.make("(checked kitchen)", "(checked hall)")
    assert world.watch.look() is None and not world.watch.skipped


def test_a_goal_that_comes_true_ends_the_plan(tour):
    tour.make("(checked hall)", "(checked kitchen)")
    verdict = tour.watch.look()
    assert verdict.achieved and verdict.reason == "the goal holds already: the rest of the plan is not needed"


def _refuse(*_):
    raise DispatchError("the knowledge base does not answer")


@pytest.mark.parametrize("looked", [True, False])
@pytest.mark.parametrize("asked", ["operator", "held", "goals", "goals_hold"])
def test_a_goal_that_came_true_while_the_knowledge_base_was_silent_is_noticed_later(
    monkeypatch, asked, looked
):
    world = world_of(*TOUR)
    if looked and asked != "operator":
        world.make("(not (open d3))")
        assert world.watch.look() is None
    with monkeypatch.context() as silent:
        silent.setattr(world, asked, _refuse)
        world.make("(checked hall)", "(checked kitchen)")
        assert world.watch.look() is None
    world.make("(wet base)")
    assert world.watch.look().achieved


def test_a_change_before_the_dispatch_is_no_other_after_a_silence_of_the_knowledge_base(monkeypatch):
    world = world_of("(check base)", goal="(checked hall)")
    late = PlanWatch(SequentialSchedule(world.actions), world, frozenset({"checked"}))
    with monkeypatch.context() as silent:
        silent.setattr(world, "held", _refuse)
        assert late.look() is None
    assert late.look() is None


def test_goals_that_the_plan_reaches_itself_do_not_end_it(tour):
    for number in (0, 1, 2):
        if number:
            tour.start(number)
        tour.end(number)
        assert tour.watch.look() is None
    tour.start(3)
    tour.finish(3)
    assert tour.watch.look() is None


def test_a_goal_that_held_and_goes_is_noticed():
    world = world_of(*TOUR, goal="(and (checked kitchen) (checked base))", init=INIT + "(checked base)")
    world.start(0)
    world.make("(not (checked base))")
    assert world.watch.look().reason == f"{OUTDATED}its goal is not reached: (checked base) does not hold"


def test_a_change_before_the_dispatch_counts_for_steps_and_not_for_goals():
    problem_of = world_of(*TOUR)
    problem_of.make("(not (open d2))")
    late = PlanWatch(SequentialSchedule(problem_of.actions), problem_of, frozenset({"open", "wet"}))
    assert "step 3, (drive d2 hall kitchen), cannot be carried out" in late.look().reason
    assert late.look() is None
    goal = world_of("(check base)")
    assert PlanWatch(SequentialSchedule(goal.actions), goal, frozenset({"checked"})).look() is None


def test_over_a_knowledge_base_that_lists_no_executions_nothing_is_judged(tour):
    tour.lists_executions = False
    tour.make("(not (open d2))")
    assert tour.watch.look() is None


def test_a_plan_without_steps_has_no_rest():
    world = world_of(goal="(at base)")
    world.make("(not (at base))")
    assert world.watch.look() is None


SHOWN = DOMAIN.replace("(:derived", "(:constraints (sometime (checked hall))) (:derived", 1)


def shown_world(domain):
    problem = f"""(define (problem p) (:domain house) (:objects base hall kitchen - room d1 d2 d3 - door
      cup - item) (:init {INIT}) (:goal (checked kitchen)))"""
    return RestWorld(domain, problem, planned("(check hall)", "(check kitchen)"))


@pytest.mark.parametrize(("domain", "skips"), [(DOMAIN, True), (SHOWN, False)])
def test_a_step_that_a_constraint_needs_is_not_skipped(domain, skips):
    world = shown_world(domain)
    world.make("(not (at base))", "(at kitchen)")
    verdict = world.watch.look()
    assert (world.watch.skipped, verdict) == ({0}, None) if skips else verdict.action is world.actions[0]


@pytest.mark.parametrize(("domain", "achieved"), [(DOMAIN, True), (SHOWN, False)])
def test_a_plan_whose_goal_came_true_goes_on_for_a_constraint(domain, achieved):
    world = shown_world(domain)
    world.make("(at hall)")
    world.watch.look()
    world.make("(checked kitchen)")
    verdict = world.watch.look()
    assert (verdict is not None and verdict.achieved) == achieved
    if not achieved:
        assert 0 not in world.watch.skipped
        world.start(0)
        world.end(0)
        world.make("(not (checked kitchen))")
        world.watch.look()
        world.make("(checked kitchen)")
        assert world.watch.look().achieved  # nothing of the rest matters to the constraint

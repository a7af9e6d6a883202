# SPDX-License-Identifier: Apache-2.0
"""Goals with deadlines as PDDL: what a planner finds for the new task is in time in the task as it was."""

import itertools
import sys
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from merlin_pddl.analysis.deadlines import DeadlineTask, Due
from merlin_pddl.checks.kairos_check import PlanValidator
from merlin_pddl.plan_text import NO_DURATION, PlanStep
from merlin_pddl.text_reader import PddlError

sys.path.insert(0, str(Path(__file__).parent))

from deadline_world import AIRPORT, LIMIT, MORNING, SATELLITE, SEARCH, SKY, SLACK, kairos, solved

EXAMPLES = settings(max_examples=30, deadline=None, derandomize=True, database=None)
TOUR = """(define (domain tour)
  (:requirements :typing :durative-actions :numeric-fluents)
  (:types room)
  (:predicates (here ?r - room) (seen ?r - room))
  (:functions (way ?from ?to - room) (drives))
  (:durative-action drive :parameters (?from ?to - room) :duration (= ?duration (way ?from ?to))
    :condition (at start (here ?from))
    :effect (and (at start (not (here ?from))) (at end (here ?to)) (at end (seen ?to))
      (at end (increase (drives) 1)))))"""


def rooms(count, way, goal="(here r0)"):
    """A problem with so many rooms, from the first one."""
    names = [f"r{number}" for number in range(count)]
    ways = " ".join(f"(= (way {a} {b}) {way(a, b)})" for a, b in itertools.permutations(names, 2))
    return (
        f"(define (problem rooms) (:domain tour) (:objects {' '.join(names)} - room) "
        f"(:init (here r0) (= (drives) 0) {ways}) (:goal {goal}))"
    )


def shortest(way, wanted):
    """Whether some order is in time: the oracle. Ways are shortest paths."""
    for order in itertools.permutations(wanted):
        at, now = "r0", 0.0
        for room in order:
            now += way(at, room) if room != at else 0.0
            if now > wanted[room]:
                break
            at = room
        else:
            return True
    return False


POINTS = st.lists(st.tuples(st.integers(0, 6), st.integers(0, 6)), min_size=4, max_size=4, unique=True)


@given(points=POINTS, deadlines=st.lists(st.integers(1, 22), min_size=3, max_size=3))
@EXAMPLES
def test_a_tour_is_found_when_one_is_in_time(points, deadlines):
    places = {f"r{number}": point for number, point in enumerate(points)}

    def way(a, b):
        return abs(places[a][0] - places[b][0]) + abs(places[a][1] - places[b][1])

    # Between whole seconds: separations add up.
    wanted = {f"r{number + 1}": deadline + 0.5 for number, deadline in enumerate(deadlines)}
    dues = [Due((f"(seen {room})",), within) for room, within in wanted.items()]
    possible = shortest(way, wanted)
    status, _ = solved(TOUR, rooms(4, way, "(seen r1)"), dues, limit=LIMIT if possible else SEARCH)
    assert (status == "SOLVED") is possible
    if any(way("r0", room) > within for room, within in wanted.items()):
        assert status == "UNSOLVABLE", "it is late by itself"


@pytest.mark.parametrize(("end", "last"), [("r0", "(drive r2 r0)"), ("r1", "(drive r2 r1)")])
def test_what_is_in_time_need_not_hold_afterwards_unless_it_is_a_goal_as_well(end, last):
    dues = [Due(("(here r1)",), 6.0), Due(("(here r2)",), 12.0)]
    _, found = solved(TOUR, rooms(3, lambda a, b: 5, f"(here {end})"), dues)
    assert found.reached[0] == pytest.approx(5.0, abs=SLACK)
    assert str(found.steps[-1]) == last


def test_how_late_goals_are_is_known_without_the_deadlines():
    dues = [Due(("(seen r1)",), 4.0), Due(("(seen r2)",), 60.0)]
    problem = rooms(3, lambda a, b: 5)
    assert solved(TOUR, problem, dues)[0] == "UNSOLVABLE"
    _, late = solved(TOUR, problem, dues, binding=False)
    assert min(late.reached) == pytest.approx(5.0, abs=SLACK) and max(late.reached) >= 10.0


@pytest.mark.parametrize(
    ("goal", "reached"),
    [
        ("(here r0)", 0.0),
        ("(not (here r0))", 0.0),  # as soon as it has left
        ("(and (seen r1) (not (here r1)))", 5.0),
        ("(>= (drives) 2)", 10.0),
        ("(forall (?r - room) (or (seen ?r) (= ?r r0)))", 10.0),
        ("(exists (?r - room) (and (seen ?r) (here ?r)))", 5.0),
    ],
)
def test_goals_of_any_kind_can_have_a_deadline(goal, reached):
    _, found = solved(TOUR, rooms(3, lambda a, b: 5), [Due((goal,), 11.0)])
    assert found.reached == (pytest.approx(reached, abs=SLACK),)


def test_time_windows_of_the_world_count_beside_the_deadlines():
    sent = "(sent star)", "(sent moon)"
    status, found = solved(SATELLITE, SKY, [Due(sent[:1], 70.0), Due(sent[1:], 88.0)])
    assert status == "SOLVED"
    status, found = solved(SATELLITE, SKY, [Due(sent[:1], 30.0)])
    assert 24.0 <= found.reached[0] <= 27.0
    assert solved(SATELLITE, SKY, [Due(sent[:1], 23.0)])[0] == "UNSOLVABLE"
    # Both images are there after 24 s, when the window is open for 3 s: the second one waits for 60.
    assert solved(SATELLITE, SKY, [Due(sent, 63.0)], limit=SEARCH)[1] is None
    assert solved(SATELLITE, SKY, [Due(sent, 66.0)])[0] == "SOLVED"


@pytest.mark.parametrize("order", [("first", "second"), ("second", "first")])
def test_the_one_that_is_due_first_uses_the_window_first(order):
    # The first one waits on the runway from 10 to 20, and is off at 25; then the other one taxis.
    early, late = ((f"(airborne {plane})",) for plane in order)
    status, found = solved(AIRPORT, MORNING, [Due(early, 26.0), Due(late, 41.0)])
    assert (status, found.reached) == (
        "SOLVED",
        (pytest.approx(25.0, abs=SLACK), pytest.approx(40.0, abs=SLACK)),
    )
    # What a closed window makes late is not proven to be.
    for dues in ([Due(early, 24.0)], [Due(early, 39.0), Due(late, 39.0)]):
        assert solved(AIRPORT, MORNING, dues, limit=SEARCH)[1] is None


def test_what_time_alone_makes_true_is_reached_then():
    _, found = solved(SATELLITE, SKY, [Due(("(visible dish)",), 40.0)])
    assert found.reached[0] == pytest.approx(20.0, abs=SLACK)
    # also when the planner marks it later
    task = DeadlineTask(SATELLITE, SKY.replace("sent star", "ready Sat1"), [Due(("(visible dish)",), 40.0)])
    late = [PlanStep(25.0, "collect-0", ())]
    assert task.unmarked(late, PlanValidator(task.domain, task.problem).fault).reached == (20.0,)


def test_names_of_the_task_are_left_alone():
    domain = TOUR.replace("(seen ?r - room)", "(seen ?r - room) (open-0) (done-0)")
    domain = domain.replace("action drive", "action collect-0")
    task = DeadlineTask(domain, rooms(2, lambda a, b: 5, "(seen r1)"), [Due(("(seen r1)",), 6.0)])
    result = kairos.solve(task.domain, task.problem, timeout=LIMIT, anytime=False)
    steps = [
        PlanStep(float(s.time), s.name, tuple(s.args), s.duration or NO_DURATION) for s in result.plan.steps
    ]
    found = task.unmarked(steps, PlanValidator(task.domain, task.problem).fault)
    assert [str(step) for step in found.steps] == ["(collect-0 r0 r1)"]


def test_where_no_action_takes_time_every_goal_is_in_time():
    domain = """(define (domain switch) (:predicates (on) (off))
      (:action turn :parameters () :precondition (off) :effect (and (on) (not (off)))))"""
    problem = "(define (problem p) (:domain switch) (:init (off)) (:goal (on)))"
    task = DeadlineTask(domain, problem, [Due(("(on)",), 0.5)])
    result = kairos.solve(task.domain, task.problem, timeout=LIMIT, anytime=False)
    steps = [PlanStep(float(s.time), s.name, tuple(s.args)) for s in result.plan.steps]
    found = task.unmarked(steps, lambda plan: None)
    assert ([str(step) for step in found.steps], found.reached) == (["(turn)"], (0.0,))


def test_constants_before_untyped_ones_keep_their_types():
    domain = """(define (domain lamps) (:requirements :durative-actions) (:constants big small)
      (:predicates (on ?l)) (:durative-action light :parameters (?l) :duration (= ?duration 2)
        :condition () :effect (at end (on ?l))))"""
    problem = "(define (problem p) (:domain lamps) (:objects third) (:init (on big)) (:goal (on small)))"
    _, found = solved(domain, problem, [Due(("(on third)",), 3.0), Due(("(on small)",), 3.0)])
    assert found.reached == (pytest.approx(2.0, abs=SLACK),) * 2


def test_new_sections_stand_where_planners_want_them():
    domain = DeadlineTask(TOUR, rooms(2, lambda a, b: 5), [Due(("(seen r1)",), 6.0)]).domain
    heads = [":requirements", ":types", ":constants", ":predicates"]  # of the constants there were none
    assert sorted(heads, key=domain.index) == heads and [domain.count(head) for head in heads] == [1] * 4


@pytest.mark.parametrize(
    ("due", "why"),
    [
        (Due(("(seen moon)",), 5.0), "moon"),
        (Due(("(seen r1",), 5.0), "closed"),
        (Due((), 5.0), "no goals"),
        (Due(("(seen r1)",), float("nan")), "nan s from the begin of the plan"),
        (Due(("(seen r1)",), 1e12), "at most 4294967296"),
        (Due(("(preference p (seen r1))",), 5.0), "preference"),
    ],
)
def test_what_has_no_deadline_says_why(due, why):
    with pytest.raises(PddlError, match=why):
        DeadlineTask(TOUR, rooms(2, lambda a, b: 5), [due])


def test_twenty_errands_each_with_its_own_deadline():
    def way(a, b):
        return 10 * abs(int(a[1:]) - int(b[1:]))

    dues = [Due((f"(seen r{number})",), 10.0 * number + 5.0) for number in range(20, 0, -1)]
    status, found = solved(TOUR, rooms(21, way), dues)
    assert status == "SOLVED" and found.reached == tuple(
        pytest.approx(10.0 * number, abs=0.1) for number in range(20, 0, -1)
    )
    hopeless = [*dues[1:], dues[0]._replace(within=195.0)]
    assert solved(TOUR, rooms(21, way), hopeless)[0] == "UNSOLVABLE"

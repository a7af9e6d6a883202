# SPDX-License-Identifier: Apache-2.0
"""The plan graph and its schedule."""

import random
from dataclasses import replace
from io import BytesIO

import pytest
from rosplan_dispatch_msgs.msg import ActionDispatch, CompletePlan

from merlin_pddl.formula import Atom as FormulaAtom
from merlin_pddl.formula import Comparison, Fluent, Forall, Number, Or, Variable
from merlin_pddl.plan_text import PlanStep
from merlin_rosplan.dispatch.dispatch_graph import GraphSchedule, SequentialSchedule
from merlin_rosplan.dispatch.dispatch_schedule import PlanError, PlannedAction
from merlin_rosplan.dispatch.operator_model import (
    ActionModel,
    Conditions,
    Inequality,
    PlanTerm,
    TimedEffects,
    WatchedCondition,
    over_all_before_start,
)
from merlin_rosplan.dispatch.plan_graph import (
    MIN_BOUND,
    NO_BOUND,
    EdgeType,
    PlanGraph,
    TimedLiteral,
    TimedValue,
)
from merlin_rosplan.dispatch.plan_graph_builder import build_graph


def at(place):
    return PlanTerm("robot_at", (place,))


MOVE = ActionModel(
    "move",
    ("from", "to"),
    at_start=Conditions(positive=(at("from"),)),
    start_effects=TimedEffects(delete=(at("from"),)),
    end_effects=TimedEffects(add=(at("to"),)),
)
ASK = ActionModel(
    "ask",
    ("p",),
    over_all=Conditions(positive=(at("p"),)),
    end_effects=TimedEffects(add=(PlanTerm("checked", ("p",)),)),
)
OPERATORS = {"move": MOVE, "ask": ASK}


def plan(*lines):
    steps = [
        PlanStep(float(time), name, tuple(arguments), float(duration))
        for time, name, arguments, duration in lines
    ]
    return steps, [OPERATORS[s.name].ground(OPERATORS[s.name].bind(s.arguments)) for s in steps]


def edges(graph):
    return {(edge.source, edge.sink): edge for edge in graph.edges}


def planned(steps):
    return [
        PlannedAction(i, s.name, tuple(enumerate(s.arguments)), s.duration, s.time)
        for i, s in enumerate(steps)
    ]


def test_two_chained_moves_as_rosplan_connects_them():
    graph = build_graph(*plan((0, "move", "ab", 10), (10, "move", "bc", 5)))
    assert [node.name for node in graph.nodes] == [
        "plan_start",
        "move_start",
        "move_end",
        "move_start",
        "move_end",
    ]
    found = edges(graph)
    assert set(found) == {(0, 1), (1, 2), (0, 2), (2, 3), (3, 4), (0, 4)}
    assert (found[1, 2].lower, found[1, 2].upper, found[1, 2].type) == (10, 10, EdgeType.START_END)
    assert (found[2, 3].lower, found[2, 3].upper, found[2, 3].type) == (
        MIN_BOUND,
        NO_BOUND,
        EdgeType.CONDITION,
    )
    for edge in graph.edges:
        assert edge.id in graph.nodes[edge.source].edges_out and edge.id in graph.nodes[edge.sink].edges_in


def test_rounded_times_do_not_turn_the_order_round():
    # 0.1 + 0.2 > 0.3 in binary; the second move needs the first one's end
    graph = build_graph(*plan((0.1, "move", "ab", 0.2), (0.3, "move", "bc", 1)))
    assert edges(graph)[2, 3].type == EdgeType.CONDITION


def test_whoever_deletes_a_condition_waits_for_its_user():
    graph = build_graph(*plan((0, "ask", "a", 5), (5, "move", "ab", 5)))
    assert edges(graph)[2, 3].type == EdgeType.INTERFERENCE  # move starts after ask has ended
    graph = build_graph(*plan((5, "move", "ab", 5), (0, "ask", "a", 5)))  # lines in another order
    assert edges(graph)[4, 1].type == EdgeType.INTERFERENCE


def test_independent_actions_only_hang_on_the_start():
    graph = build_graph(*plan((0, "move", "ab", 5), (0, "move", "cd", 5)))
    assert set(edges(graph)) == {(0, 1), (1, 2), (0, 2), (0, 3), (3, 4), (0, 4)}


def test_timed_literals_bound_who_depends_on_them():
    steps, actions = plan((10, "ask", "a", 5))
    literals = [TimedLiteral(8.0, at("a")), TimedLiteral(20.0, at("a"), negative=True)]
    found = edges(build_graph(steps, actions, literals, epsilon=0.01))
    assert found[0, 1].lower == 8.0
    assert found[0, 2].upper == pytest.approx(19.99)


def test_names_do_not_depend_on_case():
    steps, actions = plan((0, "move", ("a", "Kitchen"), 5), (5, "ask", ("KITCHEN",), 5))
    assert (2, 3) in edges(build_graph(steps, actions))


def test_changes_of_a_number_keep_their_order():
    battery = PlanTerm("battery", ("?r",))
    charged = Conditions(comparisons=(Inequality(Comparison(">", Fluent("battery", ("?r",)), Number(0.0))),))
    paint = ActionModel(
        "paint",
        ("?r",),
        at_start=charged,
        start_effects=TimedEffects(writes=(battery,)),
    )
    look = ActionModel("look", ("?r",), at_start=charged)
    operators = [paint, look, look, paint]
    steps = [PlanStep(float(i), operator.name, ("ann",), 10.0) for i, operator in enumerate(operators)]
    found = edges(build_graph(steps, [operator.ground({"?r": "ann"}) for operator in operators]))
    assert {(1, 3), (1, 5), (3, 7), (5, 7)} <= set(found) and (3, 5) not in found


def test_zero_durations_get_the_smallest_bound():
    edge = edges(build_graph(*plan((0, "move", "ab", 0))))[1, 2]
    assert (edge.lower, edge.upper) == (MIN_BOUND, MIN_BOUND)


def tour(length, places="abcd", seed=3):
    lines, here, rng = [], places[0], random.Random(seed)
    for index in range(length):
        there = rng.choice([place for place in places if place != here])
        lines += [(index * 15, "move", here + there, 10), (index * 15 + 10, "ask", there, 5)]
        here = there
    return plan(*lines)


def predecessors(graph):
    """For each node the set of nodes that must happen before it, as bits."""
    before = [0] * len(graph.nodes)
    order = sorted(graph.edges, key=lambda edge: edge.sink)  # a tour's nodes are numbered in its order
    for edge in order:
        before[edge.sink] |= before[edge.source] | (1 << edge.source)
    return before


@pytest.mark.parametrize("seed", range(5))
def test_a_reduced_graph_orders_the_same(seed):
    full, reduced = (build_graph(*tour(30, "abc", seed), reduce=reduce) for reduce in (False, True))
    assert predecessors(full) == predecessors(reduced)
    assert len(reduced.edges) < len(full.edges) / 2


def test_the_reduced_graph_of_a_long_plan_stays_small():
    graph = build_graph(*tour(1000), reduce=True)
    assert len(graph.nodes) == 4001 and len(graph.edges) < 5 * 4001


def run_in_order(schedule, order=None):
    """Runs a schedule without time: ends what runs in the given order, or oldest first."""
    schedule.begin(0.0)
    started, running = [], []
    while not schedule.finished:
        for action in schedule.ready(0.0):
            schedule.started(action.id, 0.0)
            started.append(action.id)
            running.append(action.id)
        assert running, f"stuck after {started}, waiting for {schedule.waiting()}"
        schedule.ended(running.pop(order(len(running)) if order else 0), 0.0)
    return started


def test_the_graph_starts_what_is_possible_and_no_more():
    steps, actions = plan(
        (0, "move", "ab", 5), (0, "move", "cd", 5), (5, "ask", "b", 5), (10, "move", "be", 5)
    )
    schedule = GraphSchedule(build_graph(steps, actions), planned(steps))
    schedule.begin(0.0)
    assert [a.id for a in schedule.ready(0.0)] == [0, 1]
    schedule.started(0, 0.0)
    schedule.started(1, 0.0)
    assert schedule.ready(0.0) == []
    schedule.ended(0, 1.0)
    assert [a.id for a in schedule.ready(1.0)] == [2]
    schedule.started(2, 1.0)
    schedule.ended(1, 2.0)
    assert schedule.ready(2.0) == [] and not schedule.finished
    schedule.ended(2, 3.0)
    assert [a.id for a in schedule.ready(3.0)] == [3]
    schedule.started(3, 3.0)
    schedule.ended(3, 4.0)
    assert schedule.finished and schedule.waiting() == []


@pytest.mark.parametrize("seed", range(20))
def test_random_plans_always_come_to_their_end(seed):
    rng = random.Random(seed)
    where = {"r1": "a", "r2": "b", "r3": "c"}
    operator = ActionModel(
        "go",
        ("r", "from", "to"),
        at_start=Conditions(
            positive=(PlanTerm("at", ("r", "from")),), negative=(PlanTerm("taken", ("to",)),)
        ),
        start_effects=TimedEffects(
            add=(PlanTerm("taken", ("to",)),), delete=(PlanTerm("at", ("r", "from")),)
        ),
        end_effects=TimedEffects(add=(PlanTerm("at", ("r", "to")),), delete=(PlanTerm("taken", ("to",)),)),
    )
    steps = []
    for index in range(60):
        robot = rng.choice(list(where))
        target = rng.choice("abcdef")
        steps.append(PlanStep(index * 3.0, "go", (robot, where[robot], target), 2.0))
        where[robot] = target
    actions = [operator.ground(operator.bind(step.arguments)) for step in steps]
    schedule = GraphSchedule(build_graph(steps, actions), planned(steps))
    started = run_in_order(schedule, lambda count: rng.randrange(count))
    for robot in where:  # each robot's own actions keep their order
        own = [i for i in started if steps[i].arguments[0] == robot]
        assert own == sorted(own)


def test_without_bounds_nothing_is_late_but_timed_literals_are_waited_for():
    steps, actions = plan((10, "ask", "a", 5))
    graph = build_graph(steps, actions, [TimedLiteral(8.0, at("a"))])
    schedule = GraphSchedule(graph, planned(steps))
    schedule.begin(100.0)
    assert schedule.ready(107.0) == [] and schedule.wake_time(107.0) == 108.0
    assert len(schedule.ready(108.0)) == 1 and schedule.wake_time(108.0) is None
    assert schedule.waits_for_time(0)
    schedule.started(0, 200.0)
    assert schedule.late(1e6) is None


@pytest.mark.parametrize("planned_at, earliest", [(4.0, 4.0), (2.0, 0.0)])
@pytest.mark.parametrize("read", [True, False])
def test_a_number_that_a_plain_action_reads_or_changes_waits_for_its_timed_value(read, planned_at, earliest):
    x, y = PlanTerm("x"), PlanTerm("y")
    effects = TimedEffects(writes=(y,), reads=(x,)) if read else TimedEffects(writes=(x,))
    steps = [PlanStep(planned_at, "count", (), 0.5)]
    graph = build_graph(
        steps, [ActionModel("count", (), start_effects=effects, durative=False)], [TimedValue(3.0, x, 5.0)]
    )
    schedule = GraphSchedule(graph, planned(steps))
    schedule.begin(100.0)
    assert schedule.wake_time(100.0) == (100.0 + earliest if earliest else None)
    assert bool(schedule.ready(100.0)) != bool(earliest)


def test_a_tolerance_of_bounds_does_not_start_an_action_before_its_timed_literal():
    steps, actions = plan((10, "ask", "a", 5))
    graph = build_graph(steps, actions, [TimedLiteral(8.0, at("a"))])
    schedule = GraphSchedule(graph, planned(steps), bounds=True, fraction=0.5)
    schedule.begin(100.0)
    assert schedule.ready(107.9) == [] and len(schedule.ready(108.0)) == 1


def test_with_bounds_an_action_that_takes_too_long_is_late():
    steps, actions = plan((0, "move", "ab", 10), (10, "move", "bc", 5))
    schedule = GraphSchedule(build_graph(steps, actions), planned(steps), bounds=True, fraction=0.5)
    schedule.begin(100.0)
    assert [a.id for a in schedule.ready(100.1)] == [0]
    schedule.started(0, 100.0)
    assert schedule.late(114.0) is None
    wake = schedule.wake_time(100.0)
    assert wake == pytest.approx(115.0) and schedule.late(wake)
    assert not schedule.waits_for_time(0)
    assert "(move a b) should have ended" in schedule.late(115.5)
    schedule.ended(0, 105.0)  # early is fine: the action has ended
    assert [a.id for a in schedule.ready(105.1)] == [1]


@pytest.mark.parametrize("back", [3600.0, 8.0])
def test_a_clock_that_is_set_back_keeps_no_start_waiting(back):
    steps, actions = plan((0, "move", "ab", 30), (20, "move", "cd", 5))
    graph = build_graph(steps, actions)
    graph.connect(EdgeType.INTERFERENCE, graph.nodes[1].id, graph.nodes[3].id, lower=20.0)
    schedule = GraphSchedule(graph, planned(steps))
    schedule.begin(100_000.0)
    assert [action.id for action in schedule.ready(100_000.0)] == [0]
    schedule.started(0, 100_000.0)
    assert schedule.ready(100_010.0) == [] and schedule.wake_time(100_010.0) == 100_020.0
    now = 100_010.0 - back
    assert schedule.ready(now) == [] and schedule.wake_time(now) == now + 10.0
    assert [action.id for action in schedule.ready(now + 10.0)] == [1]


def test_what_is_late_is_seen_in_time_after_the_clock_was_set_back():
    steps, actions = plan((0, "move", "ab", 10))
    schedule = GraphSchedule(build_graph(steps, actions), planned(steps), bounds=True, fraction=0.5)
    schedule.begin(100_000.0)
    schedule.started(0, 100_000.0)
    for now in (100_005.0, 200.0, 209.9):
        assert schedule.late(now) is None
    assert schedule.wake_time(209.9) == pytest.approx(210.0) and schedule.late(210.1)


def test_a_graph_with_a_cycle_is_refused():
    steps, actions = plan((0, "move", "ab", 5), (0, "move", "cd", 5))
    graph = build_graph(steps, actions)
    graph.connect(EdgeType.CONDITION, 2, 3)
    graph.connect(EdgeType.CONDITION, 4, 1)
    with pytest.raises(PlanError, match="cycle through move_start"):
        GraphSchedule(graph, planned(steps))


def test_ids_must_be_unique():
    with pytest.raises(PlanError, match="id 3"):
        SequentialSchedule([PlannedAction(3, "a"), PlannedAction(3, "b")])


def test_a_graph_without_its_end_nodes_is_refused():
    steps, actions = plan((0, "move", "ab", 5))
    graph = build_graph(steps, actions)
    cut = PlanGraph(graph.nodes[:2])
    with pytest.raises(PlanError, match="one start and one end"):
        GraphSchedule(cut, planned(steps))


def test_over_all_conditions_of_ones_own_start_are_no_preconditions():
    light = ActionModel(
        "light",
        (),
        over_all=Conditions(positive=(PlanTerm("burning"), PlanTerm("dry")), negative=(PlanTerm("dark"),)),
        start_effects=TimedEffects(add=(PlanTerm("burning"),), delete=(PlanTerm("dark"),)),
    )
    assert over_all_before_start(light) == Conditions(positive=(PlanTerm("dry"),))


EITHER = WatchedCondition(
    Or((FormulaAtom("robot_at", ("?p",)), FormulaAtom("open", ("?p",)))), frozenset(("robot_at", "open"))
)
LOOK = ActionModel("look", ("?p",), at_start=Conditions(expressions=(EITHER,)))


def test_expressions_follow_earlier_changes_of_their_names_and_precede_later_ones():
    steps = [
        PlanStep(0.0, "move", ("a", "b"), 5.0),
        PlanStep(0.0, "move", ("c", "d"), 5.0),
        PlanStep(5.0, "look", ("b",), 1.0),
        PlanStep(7.0, "move", ("b", "e"), 5.0),
    ]
    operators = {"move": MOVE, "look": LOOK}
    actions = [operators[s.name].ground(operators[s.name].bind(s.arguments)) for s in steps]
    graph = edges(build_graph(steps, actions))
    assert {(2, 5), (4, 5), (5, 7)} <= graph.keys()
    assert (2, 3) not in graph and (1, 4) not in graph  # changes of one name stay unordered among themselves


def test_grounding_leaves_quantified_variables_alone():
    inner = Forall((Variable("?p"),), FormulaAtom("near", ("?p", "?q")))
    assert str(WatchedCondition(inner).ground({"?p": "a", "?q": "b"})) == "(forall (?p - object) (near ?p b))"


def test_effects_of_plain_actions_belong_to_their_end():
    give = ActionModel("give", (), start_effects=TimedEffects(add=(PlanTerm("a"),)), durative=False)
    take = ActionModel("take", (), at_start=Conditions(positive=(PlanTerm("a"),)), durative=False)
    steps = [PlanStep(0.0, "give", (), 3.0), PlanStep(0.001, "take", (), 3.0)]
    graph = edges(build_graph(steps, [give, take]))
    assert graph[2, 3].type == EdgeType.CONDITION and (1, 3) not in graph


GOTO = ActionModel(
    "goto",
    ("from", "to"),
    at_start=Conditions(positive=(at("from"),)),
    start_effects=TimedEffects(add=(at("to"),), delete=(at("from"),)),
    durative=False,
)
SEE = ActionModel(
    "see",
    ("p",),
    at_start=Conditions(positive=(at("p"),), negative=(PlanTerm("seen", ("p",)),)),
    start_effects=TimedEffects(add=(PlanTerm("seen", ("p",)),)),
    durative=False,
)
TRIP = [(GOTO, "ab"), (SEE, "b"), (GOTO, "bc"), (GOTO, "ca"), (SEE, "a")]


def trip(as_rosplan):
    steps = [PlanStep(float(i), each.name, tuple(args), 1.0) for i, (each, args) in enumerate(TRIP)]
    actions = [each.ground(each.bind(tuple(args))) for each, args in TRIP]
    return build_graph(steps, actions, as_rosplan=as_rosplan)


def shape(graph):
    return [(edge.id, edge.type.name, edge.source, edge.sink) for edge in graph.edges]


def test_plain_actions_as_rosplan_connects_them():
    # an end changes nothing and hangs on its start and the plan's; the orders are those of the starts
    graph = trip(as_rosplan=True)
    assert shape(graph) == [
        (0, "CONDITION", 0, 1),
        (1, "START_END", 1, 2),
        (2, "CONDITION", 0, 2),
        (3, "CONDITION", 1, 3),
        (4, "START_END", 3, 4),
        (5, "CONDITION", 0, 4),
        (6, "CONDITION", 1, 5),
        (7, "INTERFERENCE", 3, 5),
        (8, "START_END", 5, 6),
        (9, "CONDITION", 0, 6),
        (10, "CONDITION", 5, 7),
        (11, "INTERFERENCE", 1, 7),
        (12, "START_END", 7, 8),
        (13, "CONDITION", 0, 8),
        (14, "CONDITION", 7, 9),
        (15, "START_END", 9, 10),
        (16, "CONDITION", 0, 10),
    ]
    assert all((edge.lower, edge.upper) == (1, 1) for edge in graph.edges if edge.type == EdgeType.START_END)
    others = [edge for edge in graph.edges if edge.type != EdgeType.START_END]
    assert all((edge.lower, edge.upper, edge.strict) == (MIN_BOUND, NO_BOUND, False) for edge in others)
    assert len(trip(as_rosplan=False).edges) > len(graph.edges)


def test_rosplan_knows_neither_numbers_nor_waits_and_protects_starts_only():
    lit, charge = PlanTerm("lit"), PlanTerm("charge")
    light = ActionModel(
        "light", (), start_effects=TimedEffects(add=(lit,)), end_effects=TimedEffects(delete=(lit,))
    )
    mend = ActionModel(
        "mend",
        (),
        over_all=Conditions(positive=(lit,)),
        at_end=Conditions(positive=(PlanTerm("ok"),)),
        end_effects=TimedEffects(writes=(charge,)),
    )
    steps = [PlanStep(0.0, "light", (), 8.0), PlanStep(1.0, "mend", (), 9.0), PlanStep(2.0, "mend", (), 1.0)]
    broken = [TimedLiteral(0.5, PlanTerm("ok")), TimedLiteral(20.0, lit, negative=True)]
    graph = build_graph(steps, [light, mend, mend], broken, as_rosplan=True)
    found = edges(graph)
    # the end of light (2) is behind the starts of mend (3, 5) that need it, and not behind their ends (4, 6)
    assert set(found) == {(0, 1), (1, 2), (1, 3), (1, 5), (3, 4), (5, 6), (0, 6), (3, 2), (5, 2), (0, 4)}
    assert (found[0, 4].lower, found[0, 4].upper) == (0.5, 19.99)
    assert not any(edge.strict for edge in graph.edges)


def test_a_window_waits_for_what_its_content_waits_for():
    light = ActionModel(
        "light",
        (),
        start_effects=TimedEffects(add=(PlanTerm("lit"),)),
        end_effects=TimedEffects(delete=(PlanTerm("lit"),)),
    )
    fetch = ActionModel("fetch", (), end_effects=TimedEffects(add=(PlanTerm("free"),)))
    mend = ActionModel(
        "mend",
        (),
        at_start=Conditions(positive=(PlanTerm("free"),)),
        over_all=Conditions(positive=(PlanTerm("lit"),)),
    )
    steps = [PlanStep(0.0, "fetch", (), 5.0), PlanStep(1.0, "light", (), 8.0), PlanStep(5.1, "mend", (), 3.0)]
    graph = edges(build_graph(steps, [fetch, light, mend]))
    assert (2, 3) in graph  # planned the other way round, and slack
    assert graph[6, 4].strict is False  # the over-all condition is watched anyway


def test_orders_of_what_ends_read_and_write_are_strict():
    set_, read = (
        ActionModel("set", (), end_effects=TimedEffects(writes=(PlanTerm("x"),), reads=(PlanTerm("y"),))),
        ActionModel("read", (), end_effects=TimedEffects(writes=(PlanTerm("y"),), reads=(PlanTerm("x"),))),
    )
    steps = [PlanStep(0.0, "set", (), 2.0), PlanStep(0.0, "read", (), 3.0)]
    graph = build_graph(steps, [set_, read])
    assert (2, 3) in edges(graph) and edges(graph)[2, 4].strict  # one after the other


def test_an_end_and_a_start_of_one_moment_keep_their_order_in_the_times_of_messages():
    steps, actions = plan((48.966, "move", "ab", 51.609), (100.575, "ask", "b", 5))
    reported = [ActionDispatch(dispatch_time=step.time, duration=step.duration) for step in steps]
    buffer = BytesIO()
    CompletePlan(plan=reported).serialize(buffer)  # float32: the end is 4 µs behind the start
    of_message = CompletePlan().deserialize(buffer.getvalue()).plan
    rounded = [replace(step, time=m.dispatch_time, duration=m.duration) for step, m in zip(steps, of_message)]
    schedule = GraphSchedule(build_graph(steps, actions), planned(rounded))
    assert schedule.happenings() == [(0, False), (0, True), (1, False), (1, True)]

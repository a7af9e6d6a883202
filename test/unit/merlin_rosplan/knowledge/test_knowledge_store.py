# SPDX-License-Identifier: Apache-2.0
import pytest
from knowledge_world import DOMAIN, add, remove, texts

from merlin_pddl.domain_reader import parse_domain
from merlin_pddl.formula import Atom, Comparison, Fluent, Not, Number, Special
from merlin_pddl.knowledge import Fact, FunctionValue, Instance, Metric, StoredGoal
from merlin_pddl.problem_reader import parse_condition, parse_problem
from merlin_rosplan.knowledge.knowledge_checks import UpdateRefused
from merlin_rosplan.knowledge.knowledge_store import KnowledgeStore


def test_facts_keep_their_order_and_come_once(store):
    add(store, Fact("checked", ("hall",)), Fact("robot_at", ("kitchen",)), Fact("checked", ("kitchen",)))
    add(store, Fact("CHECKED", ("Hall",)))
    assert texts(store.facts()) == ["(checked hall)", "(robot_at kitchen)", "(checked kitchen)"]
    assert texts(store.facts("checked")) == ["(checked hall)", "(checked kitchen)"]
    assert store.facts()[0].since == 1_000


def test_opposite_fact_turns_the_stored_one_round_in_place(store):
    add(store, Fact("checked", ("hall",)), Fact("checked", ("kitchen",)))
    add(store, Fact("checked", ("hall",), negative=True))
    assert texts(store.facts()) == ["(not (checked hall))", "(checked kitchen)"]


@pytest.mark.parametrize(
    "item, reason",
    [
        (Fact("cheked", ("hall",)), "did you mean 'checked'"),
        (Fact("", ("hall",)), "name of the predicate is empty"),
        (Fact("checked", ()), "takes 1 argument"),
        (Fact("checked", ("hal",)), "unknown object 'hal'"),
        (Fact("checked", ("",)), "the argument 'p' of 'checked' is empty"),
        (FunctionValue("power", ("r1",), 1.0), "unknown function"),
        (FunctionValue("battery", ("r1",), float("nan")), "no finite number"),
        (FunctionValue("battery", ("r1",), 1.0, op="increase"), "has no value yet"),
        (Instance("table", "t1"), "unknown type 'table'"),
        (Instance("poi", ""), "is empty"),
        (Instance("poi", "living room"), "not a name in PDDL"),
        (Fact("checked", ("anywhere",)), "'anywhere' is of type place, but 'checked' takes poi for 'p'"),
        (Fact("near", ("hall", "r1")), "'hall' is of type poi, but 'near' takes robot for 'r'"),
        (FunctionValue("battery", ("hall",), 1.0), "'battery' takes robot"),
    ],
)
def test_strict_store_refuses_and_stays_untouched(store, item, reason):
    version = store.version
    with pytest.raises(UpdateRefused) as caught:
        add(store, Fact("idle", ()), item)
    assert reason in str(caught.value)
    assert store.version == version and store.facts() == [] and store.values() == []


def test_store_that_is_not_strict_accepts_what_rosplan_accepts(clock):
    store = KnowledgeStore(DOMAIN, strict=False, clock=clock)
    add(store, Fact("anything", ("x", "")), Instance("ghost", "living room"), Fact("checked", ("hall",)))
    add(store, Fact("checked", ("",)))  # swallowed: something matches
    add(store, FunctionValue("power", (), 1.0, op="increase"))  # nothing to increase: ignored
    assert texts(store.facts()) == ["(anything x )", "(checked hall)"]
    assert store.instances("ghost") == ["living room"] and store.values() == []


def test_empty_argument_is_the_only_constant(store):
    only = parse_domain(
        "(define (domain d) (:types a b) (:constants one - a) (:predicates (p ?x - a) (q ?x - b)))"
    )
    store = KnowledgeStore(only)
    add(store, Fact("p", ("",)))
    assert texts(store.facts()) == ["(p one)"]


def test_array_is_all_or_nothing_and_order_survives(store):
    add(store, Fact("checked", ("hall",)), Fact("robot_at", ("kitchen",)), Fact("checked", ("kitchen",)))
    add(store, FunctionValue("limit", (), 3.0))
    with pytest.raises(UpdateRefused), store.transaction() as change:
        change.remove(Fact("", ()))
        change.clear()
        change.add(Instance("poi", "new"))
        change.add(Fact("unknown", ()))
    assert texts(store.facts()) == ["(checked hall)", "(robot_at kitchen)", "(checked kitchen)"]
    assert store.facts("robot_at") and store.values()[0].value == 3.0
    assert store.instances("poi") == ["kitchen", "hall"]
    with pytest.raises(UpdateRefused), store.transaction() as change:
        change.remove(Fact("checked", ("hall",)))
        change.add(Fact("unknown", ()))
    assert texts(store.facts()) == ["(checked hall)", "(robot_at kitchen)", "(checked kitchen)"]


def test_wildcards_in_remove_and_query(store):
    add(store, Fact("near", ("r1", "hall")), Fact("near", ("r1", "kitchen")), Fact("robot_at", ("hall",)))
    assert store.query([Fact("near", ("", "hall")), Fact("near", ("", "anywhere"))]) == [True, False]
    assert store.query([Fact("near", ("", "anywhere"), negative=True)]) == [True]
    remove(store, Fact("NEAR", ("", "Kitchen")))
    assert texts(store.facts()) == ["(near r1 hall)", "(robot_at hall)"]
    remove(store, Fact("unknown", ("x",)), Fact("near", ("", "")))
    assert texts(store.facts()) == ["(robot_at hall)"]
    add(store, Fact("idle", ()), Fact("checked", ("hall",), negative=True))
    remove(store, Fact("", ()))
    assert store.facts() == []


def test_an_empty_argument_of_a_derived_predicate_stands_for_any_object(clock):
    domain = parse_domain("""(define (domain d) (:requirements :derived-predicates :typing)
        (:types room) (:predicates (linked ?a ?b - room) (reach ?a ?b - room))
        (:derived (reach ?a ?b - room)
          (or (linked ?a ?b) (exists (?c - room) (and (linked ?a ?c) (reach ?c ?b))))))""")
    store = KnowledgeStore(domain, clock=clock)
    add(
        store,
        *[Instance("room", name) for name in "abc"],
        Fact("linked", ("a", "b")),
        Fact("linked", ("b", "c")),
    )
    asked = [("a", ""), ("", "a"), ("", "c"), ("c", ""), ("", "")]
    assert store.query([Fact("reach", each) for each in asked]) == [True, False, True, False, True]
    assert store.query([Fact("reach", ("c", ""), negative=True)]) == [True]


def test_queries_follow_the_closed_world(store):
    add(store, Fact("checked", ("hall",)))
    asked = [
        Fact("checked", ("hall",)),
        Fact("checked", ("kitchen",)),
        Fact("checked", ("kitchen",), negative=True),
        Fact("checked", ("hall",), negative=True),
        Fact("=", ("hall", "HALL")),
        Fact("=", ("hall", "kitchen"), negative=True),
        Instance("place", "hall"),
        Instance("place", "anywhere"),
        Instance("robot", "hall"),
        Instance("poi", ""),
        None,
    ]
    assert store.query(asked) == [True, False, True, False, True, True, True, True, False, True, False]


def test_removing_a_fact_leaves_its_explicit_negation(store):
    add(store, Fact("checked", ("hall",), negative=True))
    remove(store, Fact("checked", ("hall",)))
    assert texts(store.facts()) == ["(not (checked hall))"]


def test_removing_an_instance_takes_what_mentions_it(store):
    add(
        store,
        Fact("near", ("r1", "hall")),
        Fact("checked", ("kitchen",)),
        FunctionValue("battery", ("r1",), 5.0),
    )
    add(store, Fact("checked", ("hall",)), Fact("checked", ("kitchen",)), Instance("poi", "hall"), at=9_000)
    remove(store, Instance("poi", "hall"))
    assert texts(store.facts()) == ["(checked kitchen)"] and store.instances("poi") == ["kitchen"]
    assert [row.item.text() for row in store.timed()] == ["(checked kitchen)", "hall - poi"]
    remove(store, Instance("robot", ""))
    assert store.values() == [] and store.instances("robot") == []


@pytest.mark.parametrize("name", ["HALL", ""])
@pytest.mark.parametrize("goal", ["(checked hall)", "(forall (?r - robot) (or (near ?r hall) (idle)))"])
def test_an_instance_that_a_goal_names_stays_until_the_goal_is_removed(store, name, goal):
    stored = StoredGoal(parse_condition(goal, DOMAIN, store.objects()))
    with store.transaction() as change:
        change.add_goal(stored)
    with pytest.raises(UpdateRefused, match=r"the goal .* is still there: unknown object 'hall'; remove it"):
        remove(store, Instance("poi", name))
    assert store.instances("poi") == ["kitchen", "hall"]
    with store.transaction() as change:  # whatever the order is
        change.remove(Instance("poi", name))
        change.remove_goal(stored)
    assert "hall" not in store.instances("poi")


@pytest.mark.parametrize(
    "stated, sent",
    [
        ("(> (+ (battery r1) 1 2 3) 5)", "(> (+ (+ (+ (battery r1) 1) 2) 3) 5)"),
        ("(not (> 5 (* (+ 1 2 3) 2 (battery r1))))", "(not (> 5 (* (* (+ (+ 1 2) 3) 2) (battery r1))))"),
    ],
)
def test_a_goal_with_a_sum_of_many_is_that_of_messages_whose_operators_take_two(store, stated, sent):
    first, second = (StoredGoal(parse_condition(text, DOMAIN, store.objects())) for text in (stated, sent))
    with store.transaction() as change:
        change.add_goal(first)
        change.add_goal(second)
    assert texts(store.goals()) == [stated]
    with store.transaction() as change:
        change.remove_goal(
            StoredGoal(parse_condition("(> (+ (battery r1) (+ 1 2) 3) 5)", DOMAIN, store.objects()))
        )
    assert texts(store.goals()) == [stated]
    with store.transaction() as change:
        change.remove_goal(second)
    assert store.goals() == []


def test_without_checks_an_instance_goes_and_its_goals_and_timed_items_stay(clock):
    store = KnowledgeStore(DOMAIN, strict=False, clock=clock)
    add(store, Instance("poi", "hall"), Fact("checked", ("hall",)))
    add(store, Fact("checked", ("hall",)), at=5_000)
    with store.transaction() as change:
        change.add_goal(StoredGoal(parse_condition("(checked hall)", DOMAIN, store.objects())))
    remove(store, Instance("poi", "hall"))
    assert store.instances("poi") == [] and store.facts() == []
    assert [goal.text() for goal in store.goals()] == ["(checked hall)"]
    assert [row.item.text() for row in store.timed()] == ["(checked hall)"]


def test_an_instance_that_the_metric_names_stays(store):
    with store.transaction() as change:
        change.set_metric(Metric("minimize", Fluent("battery", ("r1",))))
    with pytest.raises(UpdateRefused, match="the metric is still there: unknown object 'r1'"):
        remove(store, Instance("robot", "r1"))
    with store.transaction() as change:
        change.set_metric(None)
    remove(store, Instance("robot", "r1"))
    assert store.instances("robot") == []


def test_a_metric_over_violations_goes_with_the_last_goal_that_has_the_preference(store):
    metric = Metric("minimize", Special("is-violated", ("tidy",)))
    with pytest.raises(UpdateRefused, match="there is no preference 'tidy'"), store.transaction() as change:
        change.set_metric(metric)
    goals = [
        StoredGoal(parse_condition(f"(preference tidy ({name}))", DOMAIN, store.objects()))
        for name in ("idle", "checked hall")
    ]
    with store.transaction() as change:
        for goal in goals:
            change.add_goal(goal)
        change.set_metric(metric)
    for goal, left in zip(goals, (metric, None)):
        with store.transaction() as change:
            change.remove_goal(goal)
        assert store.metric == left


@pytest.mark.parametrize("name", ["#t", "?duration", "total-time"])
def test_special_values_stand_where_they_mean_something(store, name):
    goal = StoredGoal(Comparison(">", Special(name), Number(1.0)))
    with pytest.raises(UpdateRefused, match="can only stand in"), store.transaction() as change:
        change.add_goal(goal)
    if name != "total-time":
        with pytest.raises(UpdateRefused, match="can only stand in"), store.transaction() as change:
            change.set_metric(Metric("minimize", Special(name)))


def test_an_object_may_lose_a_type_that_no_goal_needs(store):
    add(store, Instance("robot", "hall"))
    with store.transaction() as change:
        change.add_goal(StoredGoal(Atom("checked", ("hall",))))
    remove(store, Instance("robot", "hall"))
    with pytest.raises(UpdateRefused, match="unknown object"):
        remove(store, Instance("poi", "hall"))


def test_function_values(store):
    add(store, FunctionValue("battery", ("r1",), 10.0))
    for op, operand, expected in (
        ("increase", 2, 12),
        ("decrease", 4, 8),
        ("scale-up", 3, 24),
        ("scale-down", 4, 6),
        ("assign", 1, 1),
    ):
        add(store, FunctionValue("battery", ("R1",), operand, op=op))
        assert store.values("battery")[0].value == expected
    with pytest.raises(UpdateRefused):
        add(store, FunctionValue("battery", ("r1",), 0, op="scale-down"))
    assert store.query([FunctionValue("battery", ("",), 0), FunctionValue("limit", (), 0)]) == [True, False]


def test_instances_by_type(store):
    assert store.instances("place", constants=True) == ["anywhere"]
    assert store.instances("place", subtypes=True) == ["kitchen", "hall"]
    assert store.instances("place", constants=True, subtypes=True) == ["kitchen", "hall", "anywhere"]
    assert store.instances() == ["kitchen", "hall", "r1"]
    assert store.instances("nothing") == []
    add(store, Instance("robot", "KITCHEN"), Instance("place", "anywhere"))
    assert store.instances("robot") == ["r1", "kitchen"]  # one object, spelled as at first
    assert store.instances("place") == []  # a constant is not an instance


def test_goals(store):
    with store.transaction() as change:
        change.add_goal(StoredGoal(Atom("checked", ("hall",))))
        change.add_goal(StoredGoal(Atom("CHECKED", ("hall",))))
        change.add_goal(StoredGoal(Not(Atom("idle"))))
        change.add_goal(StoredGoal(Comparison(">", Fluent("battery", ("r1",)), Number(5.0))))
    assert texts(store.goals()) == ["(checked hall)", "(not (idle))", "(> (battery r1) 5)"]
    with pytest.raises(UpdateRefused), store.transaction() as change:
        change.add_goal(StoredGoal(Comparison(">", Fluent("power"), Number(5.0))))
    with store.transaction() as change:
        change.remove_goal(StoredGoal(Atom("checked", ("",))))
        change.remove_goal(StoredGoal(Comparison(">", Fluent("battery", ("r1",)), Number(5.0))))
    assert texts(store.goals()) == ["(not (idle))"]


def test_an_instance_goal_without_a_name_removes_those_of_its_type(store):
    with store.transaction() as change:
        for item in Instance("poi", "kitchen"), Instance("poi", "hall"), Instance("robot", "r1"):
            change.add_goal(StoredGoal(instance=item))
        change.remove_goal(StoredGoal(instance=Instance("poi", "")))
    assert [goal.instance.name for goal in store.goals()] == ["r1"]
    assert [goal.name for goal in store.snapshot()[1].instance_goals] == ["r1"]


def test_changes_are_reported_in_order(store):
    reported = []
    store.listen(reported.append)
    add(store, Fact("checked", ("hall",)), FunctionValue("limit", (), 1.0))
    add(store, Fact("checked", ("hall",)))
    add(store, Fact("checked", ("hall",), negative=True), FunctionValue("limit", (), 2.0))
    with store.transaction("me") as change:
        change.add(Fact("idle", ()))
        change.remove(Fact("idle", ()))
        change.clear()
        change.add(Instance("poi", "den"))
    assert [change.version for change in reported] == [2, 3, 4]
    assert texts(reported[0].added) == ["(checked hall)", "(limit)"]
    assert texts(reported[1].removed) == ["(checked hall)"] and texts(reported[1].added) == [
        "(not (checked hall))"
    ]
    assert [row.value for row in reported[1].changed] == [2.0]
    assert reported[2].cleared and texts(reported[2].added) == ["den - poi"] and reported[2].client == "me"


def test_clear_keeps_constants_and_sensed_flags(store):
    add(store, Fact("idle", ()))
    with store.transaction() as change:
        change.set_metric(Metric("minimize", Fluent("limit")))
        change.note(change.state.sensed, "idle", {})
        change.clear()
    assert store.facts() == [] and store.instances() == [] and store.metric is None
    assert store.instances("place", constants=True) == ["anywhere"] and store.sensed("idle")


def test_timed_items_come_true(store, clock):
    add(store, Fact("checked", ("hall",)))
    add(store, Fact("idle", ()), at=2_000)
    add(store, Fact("checked", ("hall",), negative=True), at=3_000)
    add(store, FunctionValue("limit", (), 7.0), at=2_500)
    assert store.next_due() == 2_000 and len(store.timed()) == 3 and len(store.timed("idle")) == 1
    assert store.fire_due() == [] and texts(store.facts()) == ["(checked hall)"]
    clock.now = 2_600
    assert store.fire_due() == [] and texts(store.facts()) == ["(checked hall)", "(idle)"]
    assert store.values()[0].value == 7.0 and store.next_due() == 3_000
    remove(store, Fact("checked", ("hall",), negative=True), at=3_000)
    assert store.next_due() is None
    add(store, Fact("checked", ("kitchen",)), at=4_000)
    remove(store, Instance("poi", "kitchen"))
    assert store.timed() == [] and store.next_due() is None


def test_a_snapshot_counts_timed_items_from_now(store, clock):
    add(store, Fact("idle", ()), at=5_000)
    add(store, FunctionValue("limit", (), 7.0), at=9_000)
    clock.now = 2_000
    _, problem = store.snapshot()
    assert [(timed.at, timed.item.text()) for timed in problem.timed] == [
        (3_000, "(idle)"),
        (7_000, "(limit)"),
    ]


def test_problem_that_does_not_fit_leaves_nothing(store):
    problem = parse_problem("(define (problem p) (:domain d) (:objects a - poi) (:init (checked a)))", DOMAIN)
    problem.facts.append(Fact("nonsense", ()))
    with pytest.raises(UpdateRefused):
        store.load_problem(problem)
    assert "a" not in store.instances("poi")

# SPDX-License-Identifier: Apache-2.0
"""What a strict knowledge base accepts, the planner can read: no client stops the planning of the others."""

import random

import pytest
from diagnostic_msgs.msg import KeyValue
from rosplan_knowledge_msgs.msg import DomainFormula, DomainInequality, ExprBase, ExprComposite, KnowledgeItem
from rosplan_knowledge_msgs.srv import KnowledgeUpdateServiceRequest as Request

from merlin_pddl.checks.kairos_check import check_input
from merlin_pddl.domain_reader import parse_domain
from merlin_pddl.knowledge import Fact, FunctionValue, Instance, StoredGoal
from merlin_pddl.problem_reader import parse_condition, parse_problem
from merlin_pddl.problem_writer import write_problem
from merlin_rosplan.knowledge.executions import Executions
from merlin_rosplan.knowledge.knowledge_checks import UpdateRefused
from merlin_rosplan.knowledge.knowledge_store import KnowledgeStore
from merlin_rosplan.messages.knowledge_messages import KnowledgeReader, UpdateReader
from merlin_rosplan.storage.state_file import StateFile

kairos = pytest.importorskip("kairos")

DOMAIN_TEXT = """(define (domain d) (:requirements :adl :durative-actions :fluents :derived-predicates)
  (:types place - object room - place cart - carrier cart - thing)
  (:constants dock - room)
  (:predicates (at ?c - carrier ?p - place) (lies ?t - thing ?p - place) (door ?from ?to - room)
               (linked ?x - (either room thing)) (calm) (blocked ?p - place))
  (:functions (charge ?c - carrier) (way ?from ?to - place) (total-cost))
  (:derived (blocked ?p - place) (exists (?t - thing) (lies ?t ?p)))
  (:action put :parameters (?t - thing ?p - place) :effect (and (lies ?t ?p) (at ?t ?p)))
  (:durative-action drive :parameters (?c - carrier ?from ?to - place) :duration (= ?duration 2)
    :condition (at start (at ?c ?from))
    :effect (and (at start (not (at ?c ?from))) (at end (at ?c ?to)) (decrease (charge ?c) (* #t 1)))))"""
DOMAIN = parse_domain(DOMAIN_TEXT)
PROBLEM = """(define (problem p) (:domain d) (:objects hall - room c1 - cart cup - thing)
  (:init (at c1 hall) (= (charge c1) 9) (= (way hall dock) 4)) (:goal (and)))"""
ARGUMENTS = {
    **{name: signature.parameters for name, signature in DOMAIN.predicates.items()},
    **{name: signature.parameters for name, signature in DOMAIN.functions.items()},
}
NAMES = ["hall", "dock", "c1", "cup", "HALL", "cup2", "Attic", "at", "either", "object", "start", "not", "_x"]
ODD = ["", "living room", "a(b", "é", "a\xa0b", "?x", "-", "1st", "a.b", "x;y", "total-time", "ghost", "#t"]
TYPES = ["room", "place", "thing", "cart", "carrier", "object", "ROOM", "number", "attic", ""]
NUMBERS = [0.0, 1.0, -2.5, 1e300, -1e-300, 5e-324, 1e16, float("inf"), float("-inf"), float("nan")]
TEXTS = [
    "(and)",
    "(or (calm) (lies cup {}))",
    "(forall (?t - thing) (lies ?t {}))",
    "(exists (?x - (either room thing)) (linked ?x))",
    "(preference tidy (lies cup {}))",
    "(not (preference tidy (calm)))",
    "(imply (calm) (> (charge c1) 1.5))",
    "(= {} hall)",
    "(> (total-time) 3)",
    "(< (charge c1) .5)",
    "(within 5 (calm))",
    "(at end (calm))",
    "(is-violated tidy)",
    "(blocked {})",
    "(calm",
    "(not " * 93 + "(calm)" + ")" * 93,
    "(not " * 99 + "(calm)" + ")" * 99,
]


class Client:
    """Sends updates, some of them right, the others wrong in one thing or two."""

    def __init__(self, seed):
        self.chance = random.Random(seed)
        self.pick = self.chance.choice

    def rarely(self):
        return self.chance.random() < 0.15

    def name(self):
        return self.pick(ODD) if self.rarely() else self.pick(NAMES)

    def values(self, name):
        parameters = ARGUMENTS.get(name.lower(), ())
        found = [KeyValue(self.pick(["", "p0", p.label]), self.argument(p.types)) for p in parameters]
        if self.chance.random() < 0.6:
            for pair, parameter in zip(found, parameters):
                pair.key = parameter.label
            self.chance.shuffle(found)
        if self.rarely():
            found = found[1:] if self.rarely() else [*found, KeyValue("to", self.name())]
        return found

    def argument(self, types):
        if self.rarely():
            return self.name()
        return self.pick(
            ["c1", "C1", "at"] if "carrier" in types or "thing" in types else ["hall", "dock", "Attic"]
        )

    def attribute(self):
        return self.name() if self.rarely() else self.pick([*ARGUMENTS, "DOOR"])

    def tokens(self):
        kind = self.pick([ExprBase.CONSTANT, ExprBase.FUNCTION, ExprBase.FUNCTION, ExprBase.SPECIAL])
        name = self.pick(["charge", "way", "total-cost", "is-violated", "total-time", "calm"])
        values = [KeyValue("", "tidy")] if name == "is-violated" else self.values(name)
        token = ExprBase(
            kind, self.pick(NUMBERS[:7]), DomainFormula(name, values), 0, self.pick([0, 1, 1, 2])
        )
        if self.rarely():
            token.constant = self.pick(NUMBERS)
        more = [ExprBase(expr_type=ExprBase.OPERATOR, op=self.pick([0, 1, 2, 3])), ExprBase(constant=2.0)]
        unary = [ExprBase(expr_type=ExprBase.OPERATOR, op=ExprBase.UMINUS)]
        return self.pick([[token], [token], [*more, token], [*unary, token], [*more, token, token]])

    def item(self):
        item = KnowledgeItem(
            knowledge_type=self.pick([0, 0, 1, 1, 1, 1, 2, 2, 3, 4]),
            is_negative=self.rarely(),
            instance_type=self.pick(TYPES),
            instance_name=self.name(),
            attribute_name=self.attribute(),
            function_value=self.pick(NUMBERS),
            assign_op=self.pick([0, 0, 1, 3, 4, 5]),
            optimization=self.pick(["minimize", "maximize", "Minimize", "best"]),
            expr=ExprComposite(self.tokens()),
            ineq=DomainInequality(
                self.pick(range(6)), ExprComposite(self.tokens()), ExprComposite(self.tokens()), False
            ),
        )
        if self.chance.random() < 0.4:
            item.instance_type, item.instance_name = self.pick(
                [("room", "Attic"), ("cart", "at"), ("thing", "at")]
            )
        item.values = self.values(item.attribute_name)
        if item.knowledge_type == KnowledgeItem.EXPRESSION:
            item.attribute_name = self.pick(TEXTS).format(self.name())
        item.initial_time.secs = self.pick([0, 0, 0, 0, 1, 500, 2**32 - 1])
        return item

    def updates(self):
        return [
            (self.pick([0, 0, 0, 1, 1, 2, 3, 4, 5, 6]), self.item()) for _ in range(self.pick([1, 1, 1, 3]))
        ]

    def execute(self, change):
        executions = Executions(change)
        parameters = {label: self.name() for label in ("c", "from", "to", "t", "p")}
        operator, token = self.pick(["drive", "put", "DRIVE", "fly"]), self.pick(["one", "two", ""])
        literal = self.pick(
            ["(at cup hall)", "(lies c1 dock)", "(not (calm))", "(blocked hall)", "(door dock)"]
        )
        step = self.pick([executions.start, executions.end, executions.rollback, executions.interrupt])
        more = (parameters,) if step in (executions.start, executions.end) else ()
        if step == executions.start and token and self.rarely():
            more += ("/n", [literal], [literal, "(decrease (charge c1) (* 0.1 #t))"])
        step(token, operator, *more)


def fault(store):
    """What keeps the planner from reading the knowledge; None: it reads all of it."""
    text = write_problem(store.snapshot()[1], DOMAIN)
    parse_problem(text, DOMAIN)
    found = check_input(DOMAIN_TEXT, text, "domain", "problem")
    return found and f"{found}\n{text}"


def bombard(seed, steps=25):
    client, now = Client(seed), [0]
    store = KnowledgeStore(DOMAIN, clock=lambda: now[0])
    store.load_problem(parse_problem(PROBLEM, DOMAIN))
    reader, updates = KnowledgeReader(DOMAIN), UpdateReader(DOMAIN, store.objects, True)
    accepted = 0
    for _ in range(steps):
        now[0] += 100_000_000_000
        store.fire_due()
        sent = client.updates()
        version = store.version
        try:
            with store.transaction() as change:
                if client.rarely():
                    client.execute(change)
                else:
                    for kind, item in sent:
                        updates.apply(change, kind, item)
        except UpdateRefused as error:
            assert str(error) and store.version == version
        if store.version > version:
            accepted += 1
            assert fault(store) is None, sent
        for _, item in sent:
            try:
                store.query([reader.query(item, store.objects)])
            except UpdateRefused as error:
                assert str(error)
    return accepted, store


def test_whatever_is_accepted_the_planner_reads():
    assert sum(bombard(seed)[0] for seed in range(40)) > 100


@pytest.mark.long
def test_whatever_is_accepted_the_planner_reads_by_the_thousand():
    assert sum(bombard(seed)[0] for seed in range(1_000, 4_000)) > 9_000


def test_the_others_still_get_their_plans():
    for seed in range(5):
        _, store = bombard(seed)
        with store.transaction() as change:
            change.clear()
        store.load_problem(parse_problem(PROBLEM, DOMAIN))
        bombarded = UpdateReader(DOMAIN, store.objects, True)
        client = Client(seed)
        for kind, item in client.updates() * 10:
            if kind in (Request.ADD_KNOWLEDGE, Request.REMOVE_GOAL):
                try:
                    with store.transaction() as change:
                        bombarded.apply(change, kind, item)
                except UpdateRefused:
                    continue
        with store.transaction() as change:
            change.add(Instance("room", "attic"))
            change.add(Instance("cart", "c9"))
            change.add(Fact("at", ("c9", "attic")))
            change.add(FunctionValue("charge", ("c9",), 9.0))
            change.add_goal(StoredGoal(parse_condition("(at c9 dock)", DOMAIN, store.objects())))
        result = kairos.solve(DOMAIN_TEXT, write_problem(store.snapshot()[1], DOMAIN), timeout=60.0)
        assert result.status == kairos.Status.SOLVED


LIES = Fact("lies", ("hall", "cup"))


def test_one_fact_with_objects_exchanged_does_not_stop_planning():
    store = KnowledgeStore(DOMAIN)
    store.load_problem(parse_problem(PROBLEM, DOMAIN))
    reason = "'hall' is of type room, but 'lies' takes thing for 't'"
    with pytest.raises(UpdateRefused, match=reason), store.transaction() as change:
        change.add(LIES)
    assert fault(store) is None


def test_a_constant_of_another_type_too_is_declared():
    store = KnowledgeStore(DOMAIN)
    with store.transaction() as change:
        change.add(Instance("thing", "dock"))
        change.add(Instance("place", "dock"))
        change.add(Fact("lies", ("dock", "dock")))
    assert store.snapshot()[1].objects == {"dock": ("thing",)}
    assert fault(store) is None


def test_an_effect_on_an_object_of_a_type_that_the_predicate_does_not_take_is_refused():
    store = KnowledgeStore(DOMAIN)
    store.load_problem(parse_problem(PROBLEM, DOMAIN))
    reason = "'cup' is of type thing, but 'at' takes carrier"
    with pytest.raises(UpdateRefused, match=reason), store.transaction() as change:
        Executions(change).end("", "put", {"t": "cup", "p": "hall"})
    with store.transaction() as change:
        Executions(change).end("", "put", {"t": "c1", "p": "hall"})
    assert fault(store) is None


def test_what_a_tolerant_store_has_left_in_the_state_file_is_dropped(tmp_path):
    path, reported = str(tmp_path / "state.sqlite"), []
    tolerant = KnowledgeStore(DOMAIN, strict=False, journal=StateFile(path, DOMAIN))
    tolerant.load_problem(parse_problem(PROBLEM, DOMAIN))
    with tolerant.transaction() as change:
        change.add(LIES)
        change.add(Instance("room", "living room"))
        change.add(FunctionValue("charge", ("cup",), float("inf")))
        change.add(LIES, at=10**18)
        change.add(Fact("calm", ()))
        change.add_goal(StoredGoal(parse_condition("(calm)", DOMAIN, {})))
        change.add_goal(
            StoredGoal(parse_condition("(lies ghost hall)", DOMAIN, {"ghost": ("thing",), "hall": ("room",)}))
        )
    tolerant.close()
    for number in (5, 0):  # for good
        reported.clear()
        store = KnowledgeStore(DOMAIN, journal=StateFile(path, DOMAIN), warn=reported.append)
        assert len(reported) == number, reported
        assert [row.text() for row in store.facts()] == ["(at c1 hall)", "(calm)"]
        assert [goal.text() for goal in store.goals()] == ["(calm)"]
        assert fault(store) is None
        store.close()

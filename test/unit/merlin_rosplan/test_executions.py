"""The journal of executions: any order of phases, over several tokens, with a crash anywhere."""

import shutil
import tempfile
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from merlin_pddl.domain_reader import parse_domain
from merlin_pddl.knowledge import Fact, FunctionValue, Instance
from merlin_rosplan.knowledge.executions import Executions
from merlin_rosplan.knowledge.knowledge_checks import UpdateRefused
from merlin_rosplan.knowledge.knowledge_store import KnowledgeStore
from merlin_rosplan.storage.state_file import StateFile

DOMAIN = parse_domain(
    """(define (domain d) (:types place) (:constants anywhere base hall - place)
    (:predicates (at ?p - place) (busy) (ready ?p - place) (asked ?p - place))
    (:functions (trips) (room))
    (:action ask :parameters (?p - place) :effect (and (asked ?p) (not (ready ?p)) (increase (trips) 1)))
    (:durative-action drive :parameters (?from ?to - place) :duration (= ?duration 1)
      :effect (and (at start (not (at ?from))) (at start (increase (trips) 2)) (at end (at ?to))))
    (:durative-action load :parameters (?p - place) :duration (= ?duration 1)
      :effect (and (at start (ready ?p)) (at start (assign (room) 4)) (at end (decrease (room) 1)))))"""
)
DRIVE = {"from": "base", "to": "hall"}
ANYWHERE = ["(at anywhere)"]


def open_store(path):
    return KnowledgeStore(DOMAIN, clock=lambda: 5, journal=StateFile(str(path), DOMAIN))


@pytest.fixture
def store():
    found = KnowledgeStore(DOMAIN, clock=lambda: 5)
    add(found, Fact("at", ("base",)), FunctionValue("trips", (), 0.0), FunctionValue("room", (), 9.0))
    return found


def add(store, *items):
    with store.transaction() as change:
        for item in items:
            change.add(item)


def apply(store, phase, token, *args, **more):
    with store.transaction() as change:
        return getattr(Executions(change), phase)(token, *args, **more)


def facts(store):
    return {fact.text() for fact in store.facts()}


def value(store, name):
    return store.values(name)[0].value


def test_open_executions_are_listed_with_their_owner(store):
    apply(store, "start", "1/1", "DRIVE", {"to": "HALL", "from": "base"}, "/bridges", ["(busy)"], ANYWHERE)
    apply(store, "start", "1/2", "ask", {"p": "hall"}, "/other")
    first, second = store.executions()
    assert (first.token, first.operator, first.owner, first.began) == ("1/1", "drive", "/bridges", 5)
    assert first.parameters == (("from", "base"), ("to", "hall"))
    assert second.parameters == (("p", "hall"),)
    assert store.executions("bridges") == [first]
    apply(store, "end", "1/1", "drive", DRIVE)
    assert store.executions() == [second]


def test_while_running_ends_with_the_execution_whatever_its_phase(store):
    for number, phase in enumerate(("end", "rollback", "interrupt")):
        token = str(number)
        apply(store, "start", token, "ask", {"p": "hall"}, "/n", ["(busy)", "(not (at base))"])
        assert facts(store) - {"(asked hall)"} == {"(busy)"}
        apply(store, phase, token, "ask", *([{"p": "hall"}] if phase == "end" else []))
        assert facts(store) - {"(asked hall)"} == {"(at base)"}


def test_only_what_the_start_added_is_taken_back(store):
    add(store, Fact("busy", ()))
    apply(store, "start", "t", "ask", {"p": "hall"}, "/n", ["(busy)", "(not (ready hall))"])
    apply(store, "end", "t", "ask", {"p": "hall"})
    assert facts(store) == {"(at base)", "(busy)", "(asked hall)"}


def test_what_two_need_holds_until_the_second_has_ended(store):
    apply(store, "start", "1", "ask", {"p": "hall"}, "/n", ["(busy)"])
    apply(store, "start", "2", "ask", {"p": "base"}, "/n", ["(busy)"])
    apply(store, "end", "1", "ask", {"p": "hall"})
    assert "(busy)" in facts(store)
    apply(store, "interrupt", "2")
    assert "(busy)" not in facts(store)


def test_interrupted_where_the_action_declares_what_holds_then(store):
    apply(store, "start", "t", "drive", DRIVE, "/n", ["(busy)"], ["(at anywhere)", "(not (busy))"])
    assert facts(store) == {"(busy)"} and value(store, "trips") == 2
    assert apply(store, "interrupt", "t", "drive") == ""
    assert facts(store) == {"(at anywhere)"} and value(store, "trips") == 2
    assert apply(store, "interrupt", "t", "drive") == "nothing to interrupt"
    assert apply(store, "rollback", "t", "drive") == "nothing to restore"
    assert facts(store) == {"(at anywhere)"}


def test_interrupted_where_it_declares_nothing(store):
    apply(store, "start", "t", "drive", DRIVE, "/n", ["(busy)"])
    apply(store, "interrupt", "t")
    assert facts(store) == {"(at base)"} and value(store, "trips") == 0


def test_values_that_others_changed_meanwhile(store):
    apply(store, "start", "d", "drive", DRIVE)
    apply(store, "start", "l", "load", {"p": "hall"})
    add(store, FunctionValue("trips", (), 10.0, op="increase"), FunctionValue("room", (), 1.0, op="increase"))
    assert apply(store, "interrupt", "d") == ""
    assert value(store, "trips") == 10  # a difference is taken back from whatever the value is now
    assert apply(store, "interrupt", "l") == "changed by others since, not restored: room"
    assert value(store, "room") == 5  # an assignment only when it still stands


def test_unknown_tokens_change_nothing(store):
    for phase in ("rollback", "interrupt"):
        assert "nothing to" in apply(store, phase, "never seen", "no such operator")
        assert "nothing to" in apply(store, phase, "", "drive")
    assert store.version == 1 and store.executions() == []


def test_interrupt_although_objects_are_gone():
    domain = parse_domain(
        """(define (domain d) (:types place) (:predicates (at ?p - place) (seen ?p - place))
        (:durative-action go :parameters (?p - place) :duration (= ?duration 1)
          :effect (and (at start (not (seen ?p))) (at end (at ?p)))))"""
    )
    store = KnowledgeStore(domain)
    add(store, Instance("place", "a"), Instance("place", "b"), Fact("seen", ("a",)))
    apply(store, "start", "t", "go", {"p": "a"}, "/n", ["(at b)"], ["(seen a)", "(seen b)"])
    apply(store, "start", "u", "go", {"p": "a"})
    with store.transaction() as change:
        change.remove(Instance("place", "a"))
    assert apply(store, "interrupt", "t", "go") == "not applied, because an object is gone: (seen a)"
    apply(store, "rollback", "u", "go")
    assert facts(store) == {"(seen b)"} and store.executions() == []


@pytest.mark.parametrize(
    "literal, reason",
    [
        ("(at moon)", "unknown object 'moon'"),
        ("(att base)", "did you mean 'at'"),
        ("(at ?from)", "expected a name"),
        ("(at base", "never closed"),
        ("(not)", "expected a literal"),
        ("(not (not (busy)))", "expected a literal"),
        ("(= (trips) 1)", "expected a literal"),
        ("(at base hall)", "takes 1 argument"),
        ("busy", "expected '\\('"),
    ],
)
@pytest.mark.parametrize("place", ["while_running", "if_interrupted"])
def test_literals_are_checked_before_anything_begins(store, literal, reason, place):
    with pytest.raises(UpdateRefused, match=reason):
        apply(store, "start", "t", "drive", DRIVE, **{place: [literal]})
    assert facts(store) == {"(at base)"} and store.executions() == []


def test_literals_need_a_token(store):
    with pytest.raises(UpdateRefused, match="needs a token"):
        apply(store, "start", "", "drive", DRIVE, "/n", ["(busy)"])
    apply(store, "start", "", "drive", DRIVE, "/n")
    assert facts(store) == set() and store.executions() == []


def test_token_of_another_operator_is_refused(store):
    apply(store, "start", "t", "drive", DRIVE)
    for phase in ("rollback", "interrupt"):
        with pytest.raises(UpdateRefused, match="belongs to the operator 'drive'"):
            apply(store, phase, "t", "ask")


# --- against a model -------------------------------------------------------------------------------

PLACES = ("anywhere", "base", "hall")
LITERALS = ["busy", "at anywhere", "at hall", "ready base", "not busy", "not at base", "not ready hall"]


class Model:
    """What the journal should do: sets of facts, two numbers, and a diary of what each execution changed."""

    def __init__(self):
        self.facts = set()
        self.values = {"trips": 0.0, "room": 9.0}
        self.open = {}
        self.closed = set()

    def put(self, literals):
        """Returns the literals that were not true before."""
        new = [
            text
            for text in literals
            if (text[4:] in self.facts if negative(text) else text not in self.facts)
        ]
        self.facts -= {text[4:] for text in literals if negative(text)}
        self.facts |= {text for text in literals if not negative(text)}
        return new

    def take(self, literals):
        self.put([text[4:] if negative(text) else f"not {text}" for text in literals])

    def start(self, token, operator, place, holds, interrupted):
        if token in self.open or token in self.closed:
            return
        changed, values = [], {}
        if operator == "drive":
            changed = self.put([f"not at {place}"])
            values = {"trips": ("by", self.values["trips"] + 2, 2)}
        elif operator == "load":
            changed = self.put([f"ready {place}"])
            values = {"room": ("to", 4.0, self.values["room"])}
        for name, (_, after, _) in values.items():
            self.values[name] = after
        new = self.put(holds)
        self.open[token] = {
            "operator": operator,
            "place": place,
            "changed": changed,
            "values": values,
            "holds": list(holds),
            "new": new,
            "interrupted": list(interrupted),
        }

    def no_longer(self, token):
        mine = self.open.pop(token)
        back = []
        for text in mine["new"]:
            heir = next((other for other in self.open.values() if text in other["holds"]), None)
            if heir is None:
                back.append(text)
            else:
                heir["new"].append(text)
        self.take(back)
        self.closed.add(token)
        return mine

    def end(self, token, operator, place):
        if token in self.closed:
            return
        if token in self.open:
            self.no_longer(token)
        self.closed.add(token)
        if operator == "ask":
            self.put([f"not ready {place}", f"asked {place}"])
            self.values["trips"] += 1
        elif operator == "drive":
            self.put(["at hall"])
        else:
            self.values["room"] -= 1

    def rollback(self, token):
        if token in self.open:
            self.restore(self.no_longer(token))

    def restore(self, mine):
        self.take(mine["changed"])
        for name, (kind, after, number) in mine["values"].items():
            if kind == "by":
                self.values[name] -= number
            elif self.values[name] == after:
                self.values[name] = number

    def interrupt(self, token):
        if token in self.open:
            mine = self.no_longer(token)
            if mine["interrupted"]:
                self.put(mine["interrupted"])
            else:
                self.restore(mine)


def negative(text):
    return text.startswith("not ")


def pddl(text):
    return f"(not ({text[4:]}))" if negative(text) else f"({text})"


TOKENS = {
    "a": ("drive", "base"),
    "b": ("drive", "hall"),
    "c": ("load", "hall"),
    "d": ("load", "base"),
    "e": ("ask", "hall"),
}


def consistent(literals):
    return not any(f"not {text}" in literals for text in literals)


some_literals = st.lists(st.sampled_from(LITERALS), max_size=2, unique=True).filter(consistent)
tokens = st.sampled_from(sorted(TOKENS))
commands = st.one_of(
    st.tuples(st.just("start"), tokens, some_literals, some_literals),
    st.tuples(st.sampled_from(["end", "rollback", "interrupt"]), tokens),
    st.tuples(st.just("others"), st.sampled_from(LITERALS)),
    st.tuples(st.just("increase"), st.sampled_from(["trips", "room"]), st.integers(1, 3)),
    st.tuples(st.just("crash")),
)


@settings(max_examples=300)
@given(st.lists(commands, max_size=25))
def test_any_order_of_phases_with_a_crash_anywhere(steps):
    with tempfile.TemporaryDirectory() as folder:
        check_against_the_model(Path(folder), steps)


def check_against_the_model(folder, steps):
    model, generation = Model(), 0
    store = open_store(folder / "0.sqlite")
    add(store, *(FunctionValue(name, (), number) for name, number in model.values.items()))
    for command, *args in steps:
        token = args[0] if args else ""
        operator, place = TOKENS.get(token, ("", ""))
        parameters = {"p": place, "from": place, "to": "hall"}
        if command == "crash":
            # what kill -9 leaves: the files as they are, never closed
            for suffix in ("", "-wal"):
                shutil.copy(
                    folder / f"{generation}.sqlite{suffix}", folder / f"{generation + 1}.sqlite{suffix}"
                )
            store.close()
            generation += 1
            store = open_store(folder / f"{generation}.sqlite")
        elif command == "others":
            name, *objects = token.split()[1:] if negative(token) else token.split()
            with store.transaction() as change:
                (change.remove if negative(token) else change.add)(Fact(name, tuple(objects)))
            model.put([token])
        elif command == "increase":
            add(store, FunctionValue(args[0], (), float(args[1]), op="increase"))
            model.values[args[0]] += args[1]
        elif command == "start":
            holds, interrupted = args[1:]
            if token in model.closed:
                with pytest.raises(UpdateRefused, match="has ended"):
                    apply(store, "start", token, operator, parameters)
            else:
                texts = [[pddl(text) for text in literals] for literals in (holds, interrupted)]
                apply(store, "start", token, operator, parameters, "/n", *texts)
                model.start(token, operator, place, holds, interrupted)
        elif command == "end":
            apply(store, "end", token, operator, parameters)
            model.end(token, operator, place)
        else:
            apply(store, command, token, operator)
            getattr(model, command)(token)
        assert facts(store) == {f"({text})" for text in model.facts}, command
        assert {name: value(store, name) for name in model.values} == model.values, command
        assert [found.token for found in store.executions()] == list(model.open), command
    store.close()


# --- numbers of an interruption ------------------------------------------------------------------

COURIER = parse_domain(
    """(define (domain courier) (:types place)
    (:predicates (at ?p - place)) (:functions (battery) (heat) (cost ?p - place))
    (:durative-action drive :parameters (?from ?to - place) :duration (= ?duration 10)
      :effect (and (at start (not (at ?from))) (at start (decrease (battery) 5)) (increase (heat) (* #t 2))
        (at end (at ?to)))))"""
)
GIVE_BACK = "(increase (battery) (* 5 (- 1 (/ #t ?duration))))"


class Clock:
    seconds = 0.0

    def __call__(self):
        return int(self.seconds * 1e9) + 1


@pytest.fixture
def courier():
    clock = Clock()
    store = KnowledgeStore(COURIER, clock=clock)
    add(store, Instance("place", "a"), Instance("place", "b"), Fact("at", ("a",)))
    add(
        store,
        FunctionValue("battery", (), 50.0),
        FunctionValue("heat", (), 0.0),
        FunctionValue("cost", ("b",), 3.0),
    )
    return store, clock


WAY = {"from": "a", "to": "b"}


@pytest.mark.parametrize(
    ("seconds", "battery"), [(0.0, 50.0), (0.3, 49.85), (5.0, 47.5), (10.0, 45.0), (99.0, 45.0)]
)
def test_an_interruption_charges_what_was_really_done(courier, seconds, battery):
    store, clock = courier
    apply(store, "start", "t", "drive", WAY, "/n", [], ["(at b)", GIVE_BACK])
    assert value(store, "battery") == 45
    clock.seconds = seconds
    assert apply(store, "interrupt", "t") == ""
    assert value(store, "battery") == pytest.approx(battery)
    assert value(store, "heat") == pytest.approx(2 * min(seconds, 10.0))
    assert facts(store) == {"(at b)"}
    assert apply(store, "interrupt", "t") == "nothing to interrupt"  # and not twice
    assert value(store, "battery") == pytest.approx(battery)


def test_continuous_effects_count_where_the_rest_is_undone(courier):
    store, clock = courier
    apply(store, "start", "t", "drive", WAY)
    clock.seconds = 2.0
    apply(store, "interrupt", "t")
    assert (value(store, "battery"), value(store, "heat"), facts(store)) == (50, 4, {"(at a)"})
    apply(store, "start", "u", "drive", WAY)
    clock.seconds = 4.0
    apply(store, "rollback", "u")  # it never began
    assert (value(store, "battery"), value(store, "heat")) == (50, 4)


def test_numbers_of_an_interruption_survive_a_crash_of_the_knowledge_base(tmp_path):
    clock = Clock()
    path = tmp_path / "state"
    store = KnowledgeStore(COURIER, clock=clock, journal=StateFile(str(path), COURIER))
    add(store, Instance("place", "a"), Instance("place", "b"), FunctionValue("battery", (), 50.0))
    add(store, FunctionValue("heat", (), 0.0), FunctionValue("cost", ("b",), 3.0))
    apply(store, "start", "t", "drive", WAY, "/n", [], [GIVE_BACK, "(decrease (battery) (cost b))"])
    shutil.copytree(tmp_path, tmp_path / "copy", ignore=shutil.ignore_patterns("copy"))
    back = KnowledgeStore(COURIER, clock=clock, journal=StateFile(str(tmp_path / "copy" / "state"), COURIER))
    clock.seconds = 4.0
    for found in (store, back):
        assert apply(found, "interrupt", "t") == ""
        assert value(found, "battery") == pytest.approx(50 - 5 * 0.4 - 3)
    assert back.executions() == []


def test_an_interruption_ends_although_a_number_is_gone(courier):
    store, _ = courier
    apply(store, "start", "t", "drive", WAY, "/n", [], ["(at b)", "(decrease (battery) (cost b))"])
    with store.transaction() as change:
        change.remove(Instance("place", "b"))
    assert "there is no number: (decrease (battery) (cost b))" in apply(store, "interrupt", "t")
    assert store.executions() == [] and value(store, "battery") == 45


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("(decrease (batery) 1)", "batery"),
        ("(decrease (battery))", "takes a function and a value"),
        ("(decrease (battery) (cost moon))", "unknown object 'moon'"),
        ("(decrease (battery) lots)", "lots"),
    ],
)
def test_numbers_of_an_interruption_are_checked_before_anything_begins(courier, text, reason):
    store, _ = courier
    with pytest.raises(UpdateRefused, match=reason):
        apply(store, "start", "t", "drive", WAY, "/n", [], [text])
    assert value(store, "battery") == 50 and store.executions() == []

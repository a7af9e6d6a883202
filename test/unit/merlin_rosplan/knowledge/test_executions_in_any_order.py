# SPDX-License-Identifier: Apache-2.0
"""The journal of executions against a model: phases of several tokens in any order, crashes anywhere."""

import shutil
import tempfile
from pathlib import Path

import pytest
from execution_store import add, apply, facts, open_store, value
from hypothesis import given, settings
from hypothesis import strategies as st

from merlin_pddl.knowledge import Fact, FunctionValue
from merlin_rosplan.knowledge.knowledge_checks import UpdateRefused

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
        self.closed.add(token)  # its start may still come

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

# SPDX-License-Identifier: Apache-2.0
"""Changes to facts and values that can be taken back later, from notes that fit into a journal.

What others did meanwhile stays: a fact is only put back as it was before, and a value that was changed by a
difference is changed back by it. A value that others have assigned since is left alone.
"""

from typing import Any, Dict, Iterable, List, Sequence

from merlin_pddl.knowledge import DECREASE, INCREASE, Fact, FunctionValue
from merlin_rosplan.knowledge.transaction import Transaction

#: How to take one change back, as JSON values.
Note = Dict[str, Any]


class RecordedChanges:
    """Changes a state inside a transaction. Nothing is noted of a change that changes nothing.

    :param transaction: takes the changes.
    """

    def __init__(self, transaction: Transaction) -> None:
        self._transaction = transaction
        #: how to take the changes back, in their order
        self.notes: List[Note] = []

    def bring_about(self, facts: Iterable[Fact]) -> None:
        """Deletes first, so that an added fact stays when it is named both ways."""
        for fact in sorted(facts, key=lambda fact: not fact.negative):
            (self.delete if fact.negative else self.add)(fact)

    def delete(self, fact: Fact) -> None:
        """Deletes a fact that holds."""
        if self._transaction.state.holds(fact.key):
            self.notes.append({"kind": "fact", "name": fact.name, "args": list(fact.args), "was": "true"})
            self._transaction.drop(self._transaction.state.facts, fact.key)

    def add(self, fact: Fact) -> None:
        """Adds a fact that does not hold yet.

        :raises UpdateRefused: it may not be stored: a variable of an operator may hold an object of a type
            that the predicate does not take.
        """
        known = self._transaction.state.facts.get(fact.key)
        if known is None or known.negative:
            self._transaction.checked(fact)
            was = "absent" if known is None else "negative"
            self.notes.append({"kind": "fact", "name": fact.name, "args": list(fact.args), "was": was})
            self._transaction.add_fact(fact)

    def set(self, value: FunctionValue, op: str) -> None:
        """Gives a function a value.

        :param value: the result.
        :param op: how it came about: only INCREASE and DECREASE are taken back as differences.
        :raises UpdateRefused: it may not be stored.
        """
        self._transaction.checked(value)
        before = self._transaction.state.value(value.key)
        relative = op in (INCREASE, DECREASE) and before is not None
        self._transaction.add_value(value)
        self.notes.append(
            {
                "kind": "value",
                "name": value.name,
                "args": list(value.args),
                "key": list(value.key),
                "before": before,
                "after": value.value,
                "delta": value.value - before if relative and before is not None else None,
            }
        )


def fact_of(note: Note) -> Fact:
    """The fact that a note is about, positive."""
    return Fact(note["name"], tuple(note["args"]))


def take_back(transaction: Transaction, notes: Sequence[Note]) -> List[str]:
    """Takes changes back, the last one first.

    :param notes: of one :class:`RecordedChanges`.

    Returns the names of the functions that were left alone because others have assigned them since.
    """
    kept = []
    for note in reversed(notes):
        if note["kind"] == "fact":
            _restore_fact(transaction, note)
        elif not _restore_value(transaction, note):
            kept.append(str(note["name"]))
    return kept


def _restore_fact(transaction: Transaction, note: Note) -> None:
    fact = fact_of(note)
    if note["was"] == "absent":
        transaction.drop(transaction.state.facts, fact.key)
    elif transaction.acceptable(fact):
        transaction.add_fact(Fact(fact.name, fact.args, note["was"] == "negative"))


def _restore_value(transaction: Transaction, note: Note) -> bool:
    key = tuple(note["key"])
    current = transaction.state.value(key)
    name, args = note["name"], tuple(note["args"])
    if current == note["after"]:
        if note["before"] is None:
            transaction.drop(transaction.state.values, key)
        else:
            transaction.add_value(FunctionValue(name, args, note["before"]))
        return True
    if current is None or note["delta"] is None:
        return False
    transaction.add_value(FunctionValue(name, args, current - note["delta"]))
    return True

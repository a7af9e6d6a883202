# SPDX-License-Identifier: Apache-2.0
"""Which stored facts and values make a condition true: the proof of what is derived."""

from typing import FrozenSet, Iterable, Iterator, List, Optional, Union

from merlin_explain.execution.moment import Moment
from merlin_pddl.evaluation import Evaluator
from merlin_pddl.formula import And, Atom, Comparison, Condition, Exists, Forall, Not, Or, ground
from merlin_pddl.knowledge import Key

MOST = 20_000  # conditions that are looked at
Proof = List[Condition]


def proof(moment: Moment, condition: Condition) -> Optional[Proof]:
    """The stored facts, absences and comparisons that together make a ground condition true.

    :return: None: it is not true, or no proof is found among many.
    """
    found = _Search(moment).of(condition, frozenset())
    return None if found is None else list(dict.fromkeys(found))


class _Search:
    def __init__(self, moment: Moment) -> None:
        self._moment = moment
        self._evaluator = Evaluator(moment.domain, moment)
        self._looked = 0

    def of(self, condition: Condition, open_: FrozenSet[Key]) -> Optional[Proof]:
        """A proof that does not rest on what is being proven."""
        self._looked += 1
        if self._looked > MOST:
            return None
        if isinstance(condition, Atom):
            return self._atom(condition, open_)
        if isinstance(condition, And):
            return self._all(condition.parts, open_)
        if isinstance(condition, Or):
            return self._first(condition.parts, open_)
        if isinstance(condition, Exists):
            return self._first(self._instances(condition), open_)
        if isinstance(condition, Forall):
            return self._all(self._instances(condition), open_)
        if not self._evaluator.holds(condition):
            return None
        return [condition] if isinstance(condition, (Not, Comparison)) else []

    def _atom(self, atom: Atom, open_: FrozenSet[Key]) -> Optional[Proof]:
        key = (atom.name.lower(), *(arg.lower() for arg in atom.args))
        if self._moment.holds(key):
            return [atom]
        if key in open_ or not self._evaluator.holds(atom):
            return None
        for rule in self._moment.domain.derived.get(key[0], ()):
            names = [parameter.name for parameter in rule.head.parameters]
            if len(names) == len(key) - 1:
                found = self.of(ground(rule.body, dict(zip(names, key[1:]))), open_ | {key})
                if found is not None:
                    return found
        return None

    def _all(self, parts: Iterable[Condition], open_: FrozenSet[Key]) -> Optional[Proof]:
        found: Proof = []
        for part in parts:
            more = self.of(part, open_)
            if more is None:
                return None
            found += more
        return found

    def _first(self, parts: Iterable[Condition], open_: FrozenSet[Key]) -> Optional[Proof]:
        found = (self.of(part, open_) for part in parts)
        return next((each for each in found if each is not None), None)

    def _instances(self, condition: Union[Exists, Forall]) -> Iterator[Condition]:
        for bindings in self._evaluator.extend(condition.variables, {}):
            yield ground(condition.part, bindings)

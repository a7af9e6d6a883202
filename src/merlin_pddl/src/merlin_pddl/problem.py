# SPDX-License-Identifier: Apache-2.0
"""A planning problem: what exists, what holds at the start, what is wanted."""

from dataclasses import dataclass, field, replace
from typing import Dict, Iterable, List, Mapping, Optional, Tuple

from merlin_pddl.formula import Atom, Comparison, Condition, Fluent, Not, Number, to_pddl
from merlin_pddl.knowledge import Fact, FunctionValue, Instance, Metric, Timed
from merlin_pddl.plan_text import call_text


@dataclass
class Problem:
    """A problem as its file, or a knowledge base, states it.

    `timed` holds nanoseconds after the start; `goals` is a conjunction; `instance_goals` want an object to
    exist, which PDDL cannot say; `constraints` are trajectory constraints as PDDL text.
    """

    name: str
    domain_name: str
    objects: Dict[str, Tuple[str, ...]] = field(default_factory=dict)
    facts: List[Fact] = field(default_factory=list)
    values: List[FunctionValue] = field(default_factory=list)
    timed: List[Timed] = field(default_factory=list)
    goals: List[Condition] = field(default_factory=list)
    instance_goals: List[Instance] = field(default_factory=list)
    metric: Optional[Metric] = None
    constraints: List[str] = field(default_factory=list)

    def typed(self, constants: Mapping[str, Tuple[str, ...]]) -> Dict[str, Tuple[str, ...]]:
        """The objects and these constants (lower-case) with their types; what is both has all of them."""
        found = dict(constants)
        for name, types in self.objects.items():
            found[name.lower()] = tuple(dict.fromkeys((*found.get(name.lower(), ()), *types)))
        return found

    def changed(self, changes: Iterable[Condition]) -> "Problem":
        """A copy with other facts and values at its start.

        :param changes: literals, and numbers as ``(= (battery) 20)``.
        :raises ValueError: one is something else, or two cannot both be true.
        """
        facts = {fact.key: fact for fact in self.facts}
        values = {value.key: value for value in self.values}
        given: Dict[Tuple[str, ...], float] = {}
        for change in changes:
            atom = change.part if isinstance(change, Not) else change
            if isinstance(atom, Atom):
                fact = Fact(atom.name, atom.args)
                facts.pop(fact.key, None)
                key, wanted = ("fact", *fact.key), float(atom is change)
                if wanted:
                    facts[fact.key] = fact
            elif (
                isinstance(change, Comparison)
                and change.op == "="
                and isinstance(change.left, Fluent)
                and isinstance(change.right, Number)
            ):
                value = FunctionValue(change.left.name, change.left.args, change.right.value)
                values[value.key] = value
                key, wanted = ("value", *value.key), value.value
            else:
                raise ValueError(f"{to_pddl(change)} sets neither a fact nor a value; write (= (battery) 20)")
            if given.setdefault(key, wanted) != wanted:
                raise ValueError(f"{call_text(key[1], key[2:])} is given twice, and both cannot be true")
        return replace(self, facts=list(facts.values()), values=list(values.values()))

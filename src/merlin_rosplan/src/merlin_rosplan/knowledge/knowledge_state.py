# SPDX-License-Identifier: Apache-2.0
"""The content of a knowledge base, without locks: tables, and the questions asked of them."""

from typing import Any, Callable, Dict, List, Optional, Tuple, Union

from merlin_pddl.domain import Domain
from merlin_pddl.evaluation import Evaluator, WorldState
from merlin_pddl.formula import Atom, Condition, Exists, Variable
from merlin_pddl.knowledge import Fact, FunctionValue, Instance, Key, Metric, Row, StoredGoal, Timed
from merlin_rosplan.knowledge.knowledge_table import ArgumentTable, InstanceTable, Table


class MetricRow(Row):
    """The metric, as the one row of its table."""

    __slots__ = ("metric",)

    def __init__(self, metric: Metric) -> None:
        super().__init__()
        self.metric = metric

    @property
    def key(self) -> str:
        """What identifies it in its table."""
        return "metric"


class Note(Row):
    """A small thing kept by name: the sensed flag of a predicate, a running action, a one-of group."""

    __slots__ = ("name", "data")

    def __init__(self, name: str, data: Dict[str, Any]) -> None:
        super().__init__()
        self.name = name
        self.data = data

    @property
    def key(self) -> str:
        """What identifies it in its table."""
        return self.name


class KnowledgeTables(WorldState):
    """Tables of a knowledge base over a domain."""

    def __init__(self, domain: Domain) -> None:
        self.domain = domain
        self.instances = InstanceTable("instance")
        self.facts: ArgumentTable[Fact] = ArgumentTable("fact")
        self.values: ArgumentTable[FunctionValue] = ArgumentTable("value")
        self.timed: Table[Timed] = Table("timed")
        self.goals: Table[StoredGoal] = Table("goal")
        self.metric: Table[MetricRow] = Table("metric")
        self.sensed: Table[Note] = Table("sensed")
        self.executions: Table[Note] = Table("execution")
        self.oneof: Table[Note] = Table("oneof")
        #: what `clear` empties
        self.knowledge = (
            self.instances,
            self.facts,
            self.values,
            self.timed,
            self.goals,
            self.metric,
            self.oneof,
        )
        self.tables: Dict[str, Table[Any]] = {
            table.kind: table for table in (*self.knowledge, self.sensed, self.executions)
        }

    def copy(self) -> "KnowledgeTables":
        """The objects, facts and values as they are now, to be asked while this state changes."""
        twin = KnowledgeTables(self.domain)
        twin.instances = self.instances.copy()
        twin.facts, twin.values = self.facts.copy(), self.values.copy()
        return twin

    # --- for the evaluator ----------------------------------------------------------------------

    def holds(self, key: Key) -> bool:
        """Whether that fact is stored as true."""
        fact = self.facts.get(key)
        return fact is not None and not fact.negative

    def value(self, key: Key) -> Optional[float]:
        """The value of that function, None when it has none."""
        row = self.values.get(key)
        return None if row is None else row.value

    def objects(self, types: Tuple[str, ...]) -> List[str]:
        """Objects (lower-case) of these types and of types below: constants first."""
        found: List[str] = []
        for type_name in types:
            found += self.domain.constants_of(type_name)
            # undeclared types can only be stored when not strict: they are objects
            below = self.domain.types.subtypes(type_name)
            listed = self.instances.types() if type_name == "object" else below
            for kind in listed:
                found += [instance.name.lower() for instance in self.instances.of_type(kind)]
        return list(dict.fromkeys(found))

    # --- questions ------------------------------------------------------------------------------

    def object_types(self, name: str) -> Tuple[str, ...]:
        """All types of an object, its constants' types first; empty when there is no such object."""
        lower = name.lower()
        declared = self.domain.constants.get(lower, ())
        return declared + tuple(
            instance.type_name
            for instance in self.instances.named(lower)
            if instance.type_name not in declared
        )

    def spelling(self, name: str) -> Optional[str]:
        """An object as it was first written; None when there is no such object."""
        lower = name.lower()
        return lower if lower in self.domain.constants else self.instances.spelling(lower)

    def all_objects(self) -> Dict[str, Tuple[str, ...]]:
        """Every object (lower-case) with its types, constants included."""
        found = dict(self.domain.constants)
        for instance in self.instances.all():
            lower = instance.name.lower()
            found[lower] = (*found.get(lower, ()), instance.type_name.lower())
        return found

    def true(
        self,
        item: Union[Instance, Fact, FunctionValue, Condition],
        between: Callable[[], None] = lambda: None,
    ) -> bool:
        """Whether something holds. An empty name or argument fits anything.

        :param between: as of :class:`Evaluator`.
        """
        if isinstance(item, Instance):
            return self._instance_true(item)
        if isinstance(item, Fact):
            return self._fact_true(item, between)
        if isinstance(item, FunctionValue):
            return self.values.first(item.key) is not None
        return Evaluator(self.domain, self, between=between).holds(item)

    def _instance_true(self, item: Instance) -> bool:
        wanted = item.type_name.lower()
        if not item.name:
            return bool(self.objects((wanted or "object",)))
        types = self.object_types(item.name)
        if not wanted:
            return bool(types)
        return any(self.domain.types.is_a(actual.lower(), wanted) for actual in types)

    def _some(self, name: str, args: List[str]) -> Condition:
        """That an atom holds, for some objects where an argument is empty."""
        parameters = enumerate(self.domain.predicates[name].parameters[: len(args)])
        free = {at: Variable(f"?{at}", parameter.types) for at, parameter in parameters if not args[at]}
        atom = Atom(name, tuple(free[at].name if at in free else arg for at, arg in enumerate(args)))
        return Exists(tuple(free.values()), atom) if free else atom

    def _fact_true(self, item: Fact, between: Callable[[], None]) -> bool:
        name, *args = item.key
        if not name:
            return bool(self.facts.rows)
        if name == "=" and len(args) == 2:  # conditions of an operator are asked like this
            return (args[0] == args[1]) != item.negative
        if name in self.domain.derived:
            return self.true(self._some(name, args), between) != item.negative
        if "" not in args:
            return self.holds(item.key) != item.negative
        some = any(not self.facts.rows[key].negative for key in self.facts.match(name, args))
        return some != item.negative

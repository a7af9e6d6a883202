# SPDX-License-Identifier: Apache-2.0
"""Changes to a knowledge state that happen together or not at all."""

import contextlib
import re
from dataclasses import dataclass, field
from typing import Any, Dict, List, Optional, Set, Tuple, Union

from merlin_pddl.evaluation import changed, key_of
from merlin_pddl.knowledge import ASSIGN, Fact, FunctionValue, Instance, Metric, Row, StoredGoal, Timed
from merlin_rosplan.knowledge.knowledge_checks import KnowledgeChecks, UpdateRefused
from merlin_rosplan.knowledge.knowledge_state import KnowledgeTables, MetricRow, Note
from merlin_rosplan.knowledge.knowledge_table import ArgumentTable, Table

Item = Union[Instance, Fact, FunctionValue]

_WORD = re.compile(r"[^\s()]+")


@dataclass
class StateChange:
    """What one transaction changed, for listeners. Facts that turned round are removed and added."""

    version: int
    client: str
    added: List[Item] = field(default_factory=list)
    removed: List[Item] = field(default_factory=list)
    changed: List[FunctionValue] = field(default_factory=list)
    goals_added: List[StoredGoal] = field(default_factory=list)
    goals_removed: List[StoredGoal] = field(default_factory=list)
    cleared: bool = False


#: One step: table, key, row before, row after. A swap of the whole table has the key None and dictionaries.
Step = Tuple["Table[Any]", Any, Any, Any]


class Transaction:
    """Changes a state step by step and can take all of it back. The caller holds the store's lock.

    :param state: is changed at once, so that later steps see the earlier ones.
    :param checks: refuses what does not fit the domain; None accepts everything, as ROSPlan does.
    :param now: time of the changes, ns.
    :param passed: s on a line of time that is never set; executions last differences on it.
    :param next_order: the order of the next row; rows added later have higher ones.
    """

    def __init__(
        self,
        state: KnowledgeTables,
        checks: Optional[KnowledgeChecks],
        now: int,
        passed: float,
        next_order: int,
    ) -> None:
        self.state = state
        self.now = now
        self.passed = passed
        self.next_order = next_order
        self.steps: List[Step] = []
        self.cleared = False
        self._checks = checks
        self._gone: Set[str] = set()  # objects, lower-case, of which a type was removed

    # --- steps ----------------------------------------------------------------------------------

    def put(self, table: "Table[Any]", row: Row, replacing: Optional[Row] = None) -> None:
        """Stores a row, in the place of another one if there is one."""
        if replacing is not None:
            row.order = replacing.order
        else:
            row.order = self.next_order
            self.next_order += 1
        table.put(row.key, row)
        self.steps.append((table, row.key, replacing, row))

    def drop(self, table: "Table[Any]", key: Any) -> None:
        """Drops a row if it exists."""
        row = table.get(key)
        if row is not None:
            table.remove(key)
            self.steps.append((table, key, row, None))

    def undo(self) -> None:
        """Takes all its steps back, the last one first."""
        came_back = set()
        for table, key, before, after in reversed(self.steps):
            if key is None:
                table.swap(before)
            elif before is None:
                table.remove(key)
            else:
                table.put(key, before)
                if after is None:
                    came_back.add(table.kind)
        for kind in came_back:
            self.state.tables[kind].sort()
        self.steps.clear()

    # --- updates --------------------------------------------------------------------------------

    def add(self, item: Item, at: int = 0) -> None:
        """Adds knowledge; with a time that is still to come, when that time comes.

        :raises UpdateRefused: it is refused.
        """
        checked = self.checked(item)
        if at > self.now:
            self.put(self.state.timed, self._in_order(Timed(at, checked)))
        elif isinstance(checked, Instance):
            self._add_instance(checked)
        elif isinstance(checked, Fact):
            self.add_fact(checked)
        else:
            self.add_value(checked)

    def checked(self, item: Item) -> Item:
        """The item with the domain's spelling, if it may be added.

        :raises UpdateRefused: it may not.
        """
        if self._checks is None:
            return item
        if isinstance(item, Instance):
            return self._checks.instance(item)
        return self._checks.fact(item) if isinstance(item, Fact) else self._checks.value(item)

    def acceptable(self, item: Item) -> bool:
        """Whether an item may be added."""
        with contextlib.suppress(UpdateRefused):
            self.checked(item)
            return True
        return False

    def _in_order(self, row: Timed) -> Timed:
        row.order = self.next_order  # it is the row's key
        return row

    def _add_instance(self, item: Instance) -> None:
        declared = self.state.domain.constants.get(item.name.lower(), ())
        if item.type_name.lower() not in declared and self.state.instances.get(item.key) is None:
            self.put(self.state.instances, item)

    def add_fact(self, item: Fact) -> None:
        """Adds a checked fact: an existing one stays, one of the opposite sign changes its sign."""
        known = self.state.facts.first(item.key)
        item.since = item.since or self.now
        if known is None:
            self.put(self.state.facts, item)
        elif known.negative != item.negative:
            turned = Fact(known.name, known.args, item.negative, item.since, known.labels)
            self.put(self.state.facts, turned, replacing=known)

    def add_value(self, item: FunctionValue) -> None:
        """Sets or changes a checked function value.

        :raises UpdateRefused: there is no value to change, or the result is not a number.
        """
        known = self.state.values.first(item.key)
        if known is None and item.op != ASSIGN:
            if self._checks is None:
                return  # as ROSPlan: nothing to change, nothing happens
            raise UpdateRefused(f"{item.text()} has no value yet that could {item.op}")
        before = known.value if known is not None else None
        value = changed(item.op, before, item.value)
        if value is None:
            raise UpdateRefused(f"{item.text()}: {before} {item.op} {item.value} is not a number")
        if before != value:
            first = known or item
            after = FunctionValue(first.name, first.args, value, item.since or self.now, labels=first.labels)
            self.put(self.state.values, after, replacing=known)

    def remove(self, item: Item, at: int = 0) -> None:
        """Removes knowledge; an empty name or argument fits anything. What does not exist is not an error.

        With a time that is still to come, the first timed item of exactly that time that fits; if there is
        none, what holds now.
        """
        if at > self.now:
            for row in self.state.timed.all():
                if row.at == at and fits(item, row.item):
                    self.drop(self.state.timed, row.key)
                    return
        if isinstance(item, Instance):
            self._remove_instances(item)
            return
        table: ArgumentTable[Any] = self.state.facts if isinstance(item, Fact) else self.state.values
        name, *args = item.key
        for key in list(table.match(name, args)):
            if fits(item, table.rows[key]):
                self.drop(table, key)

    def _remove_instances(self, item: Instance) -> None:
        type_name = item.type_name.lower()
        if item.name:
            names = [item.name.lower()]
        else:
            names = [instance.name.lower() for instance in self.state.instances.of_type(type_name)]
        for name in names:
            self.drop(self.state.instances, (type_name, name))
            self._gone.add(name)
            for row in self.state.timed.all() if self._checks is not None else ():  # ROSPlan keeps them
                if not isinstance(row.item, Instance) and name in row.item.key[1:]:
                    self.drop(self.state.timed, row.key)
            for table in (self.state.facts, self.state.values):
                for key in table.mentioning(name):
                    self.drop(table, key)

    def add_goal(self, goal: StoredGoal) -> None:
        """Adds a goal unless it exists.

        :raises UpdateRefused: it names something unknown.
        """
        checked = self._checks.goal(goal) if self._checks is not None else goal
        checked.since = goal.since or self.now
        if self.state.goals.get(checked.key) is None:
            self.put(self.state.goals, checked)

    def remove_goal(self, goal: StoredGoal) -> None:
        """Removes every goal that fits; an empty name or argument fits anything."""
        known = self.state.goals.get(goal.key)
        for row in self.state.goals.all() if known is None else (known,):
            if goal_fits(goal, row):
                self.drop(self.state.goals, row.key)
        # A metric over preferences of a goal that is gone means nothing any more.
        found = self.state.metric.get("metric")
        if self._checks is not None and found is not None and self._checks.unknown(found.metric):
            self.drop(self.state.metric, "metric")

    def settle(self) -> None:
        """Checks what the steps together have left; nothing is left about an object that is gone.

        :raises UpdateRefused: a goal or the metric still names it.
        """
        if self._checks is None or not self._gone:
            return
        for row in self.state.goals.all():
            if row.instance is None and not self._gone.isdisjoint(_WORD.findall(row.key)):
                self._checks.check_again(row)
        metric = self.state.metric.get("metric")
        try:
            if metric is not None:
                self._checks.metric(metric.metric)
        except UpdateRefused as error:
            raise UpdateRefused(f"the metric is still there: {error}") from error

    def set_metric(self, metric: Optional[Metric]) -> None:
        """Replaces the metric; None drops it.

        :raises UpdateRefused: it names something unknown.
        """
        known = self.state.metric.get("metric")
        if metric is None:
            self.drop(self.state.metric, "metric")
            return
        checked = self._checks.metric(metric) if self._checks is not None else metric
        if known is None or known.metric != checked:
            self.put(self.state.metric, MetricRow(checked), replacing=known)

    def clear(self) -> None:
        """Drops all knowledge, goals and the metric. The domain and the sensed flags stay."""
        for table in self.state.knowledge:
            if table.rows:
                self.steps.append((table, None, table.swap({}), {}))
        self.cleared = True

    def note(self, table: "Table[Note]", name: str, data: Optional[Dict[str, object]]) -> None:
        """Keeps a note, or drops it."""
        if data is None:
            self.drop(table, name)
        else:
            self.put(table, Note(name, data), replacing=table.get(name))

    def fire(self, row: Timed) -> None:
        """Applies a timed item now. A negative fact takes the positive one away, as in ROSPlan.

        :raises UpdateRefused: it no longer fits: its objects are gone.
        """
        self.drop(self.state.timed, row.key)
        if isinstance(row.item, Fact) and row.item.negative:
            self.remove(Fact(row.item.name, row.item.args))
        else:
            self.add(row.item)

    def change(self, version: int, client: str) -> StateChange:
        """The net effect so far."""
        found = StateChange(version, client, cleared=self.cleared)
        ends: Dict[Tuple[str, Any], Tuple[Any, Any]] = {}  # of what was changed: the row before, and after
        for table, key, before, after in self.steps:
            if key is None:
                # watchers get `cleared`; what the transaction did before is gone with the rest
                ends = {place: rows for place, rows in ends.items() if place[0] != table.kind}
                continue
            place = (table.kind, key)
            ends[place] = (ends[place][0] if place in ends else before, after)
        for (kind, _), (before, after) in ends.items():
            if before is after:
                continue
            if kind == "goal":
                found.goals_removed.extend([before] if before is not None else [])
                found.goals_added.extend([after] if after is not None else [])
            elif kind == "value" and before is not None and after is not None:
                found.changed.append(after)
            elif kind in ("instance", "fact", "value"):
                found.removed.extend([before] if before is not None else [])
                found.added.extend([after] if after is not None else [])
        return found


def fits(pattern: Item, item: Item) -> bool:
    """Whether an item is what a pattern describes; an empty name or argument of the pattern fits anything."""
    if isinstance(pattern, Instance):
        return (
            isinstance(item, Instance)
            and pattern.type_name.lower() == item.type_name.lower()
            and pattern.name.lower() in ("", item.name.lower())
        )
    if isinstance(item, Instance) or isinstance(pattern, Fact) != isinstance(item, Fact):
        return False
    if not pattern.name:
        return True
    if isinstance(pattern, Fact) and isinstance(item, Fact) and pattern.negative != item.negative:
        return False
    return key_fits(pattern.key, item.key)


def key_fits(pattern: Tuple[str, ...], key: Tuple[str, ...]) -> bool:
    """Whether a key has the pattern's name and its arguments where those are not empty."""
    return (
        len(pattern) == len(key)
        and pattern[0] == key[0]
        and all(wanted in ("", actual) for wanted, actual in zip(pattern[1:], key[1:]))
    )


def goal_fits(pattern: StoredGoal, goal: StoredGoal) -> bool:
    """Whether a goal is what a pattern describes; an empty name or argument fits anything."""
    if pattern.instance is not None:
        return goal.instance is not None and fits(pattern.instance, goal.instance)
    wanted, actual = pattern.literal, goal.literal
    if wanted is None or actual is None:
        return pattern.key == goal.key
    if not wanted[0].name:
        return True
    return wanted[1] == actual[1] and key_fits(key_of(wanted[0], {}), key_of(actual[0], {}))

# SPDX-License-Identifier: Apache-2.0
"""The knowledge of a robot in memory: thread-safe, atomic, versioned, and written to a journal.

One lock guards the state; every public method takes it for as long as it needs the tables and no longer.
Rows never change once they are stored, so lists of them can be read without it. What may take long to answer
is asked of a copy: neither updates nor other questions wait for it.
"""

import gc
import heapq
import threading
from collections import deque
from contextlib import contextmanager
from typing import Any, Callable, Deque, Dict, Iterator, List, Optional, Sequence, Tuple, Union

from merlin_pddl.domain import Domain
from merlin_pddl.formula import Atom, Condition, Exists, Forall, walk
from merlin_pddl.knowledge import Fact, FunctionValue, Instance, Metric, Row, StoredGoal, Timed
from merlin_pddl.problem import Problem
from merlin_ros.work.threads import log_failure
from merlin_rosplan.knowledge.executions import OpenExecution, open_executions
from merlin_rosplan.knowledge.knowledge_checks import KnowledgeChecks, UpdateRefused
from merlin_rosplan.knowledge.knowledge_state import KnowledgeTables
from merlin_rosplan.knowledge.knowledge_table import Table
from merlin_rosplan.knowledge.transaction import Item, StateChange, Step, Transaction

LONG = 500  # items of one question from when it is asked of a copy


class JournalError(UpdateRefused):
    """A change is refused because the journal cannot be written, a full disk for example."""


class Journal:
    """Keeps a store's state beyond the life of the process."""

    def load(self) -> Tuple[int, List[Tuple[str, Row]]]:
        """Version and rows (with the kind of their table) of the last commit, in their order."""
        raise NotImplementedError

    def commit(self, steps: Sequence[Step], version: int) -> None:
        """Writes a transaction; when this returns, a killed process finds it again.

        :raises OSError: it could not be written.
        """
        raise NotImplementedError

    def close(self) -> None:
        """Ends writing."""


class KnowledgeStore:
    """Knowledge over a domain.

    :param domain: what may be said.
    :param strict: refuse what the domain does not know (see :class:`KnowledgeChecks`); else accept
        everything.
    :param clock: now, in nanoseconds of ROS time.
    :param journal: where every transaction is written before it counts; its content is loaded first.
    :param passed: s that have passed, also while the clock is set; without it, the clock counts.
    :param warn: gets a sentence when a strict store drops something of its journal; must not block.

    What the journal raises when it cannot be read is passed on.
    """

    def __init__(
        self,
        domain: Domain,
        strict: bool = True,
        clock: Callable[[], int] = lambda: 0,
        journal: Optional[Journal] = None,
        warn: Callable[[str], None] = lambda text: None,
        passed: Optional[Callable[[], float]] = None,
    ) -> None:
        self.domain = domain
        self.version = 0
        self._lock = threading.RLock()
        self._state = KnowledgeTables(domain)
        self._copy: Optional[KnowledgeTables] = None  # of the state as it is, once one was needed
        self._checks = KnowledgeChecks(self._state) if strict else None
        self._clock = clock
        self._passed = passed or (lambda: clock() / 1e9)
        self._journal = journal
        self._next_order = 1
        self._due: List[Tuple[int, int]] = []  # heap of (time, key) of timed items, some of them gone
        self._listeners: List[Callable[[StateChange], None]] = []
        self._undelivered: Deque[StateChange] = deque()
        self._delivery = threading.Lock()  # held while the listeners are called: keeps versions in order
        if journal is not None:
            try:
                self._load(journal)
                self._drop_refused(warn)
            except BaseException:
                journal.close()
                raise

    def _load(self, journal: Journal) -> None:
        # Nothing of a million new objects is garbage: looking for some takes longer than making them.
        collects = gc.isenabled()
        gc.disable()
        try:
            self._fill(journal)
        finally:
            if collects:
                gc.enable()

    def _fill(self, journal: Journal) -> None:
        self.version, rows = journal.load()
        by_table: Dict[str, List[Row]] = {kind: [] for kind in self._state.tables}
        for kind, row in rows:
            by_table[kind].append(row)
        for kind, loaded in by_table.items():
            self._state.tables[kind].load(loaded)
        for execution in self._state.executions.all():
            execution.data.pop("passed", None)  # it was counted by another process
        self._next_order = 1 + max((row.order for _, row in rows), default=0)
        self._queue_timed(self._state.timed.all())

    def _drop_refused(self, warn: Callable[[str], None]) -> None:
        """Drops what a store that was not strict has left, and no planner can read."""
        if self._checks is None:
            return
        state, checks = self._state, self._checks
        with self.transaction("state file") as transaction:
            rules: Tuple[Tuple[Table[Any], Callable[[Any], object]], ...] = (
                (state.instances, checks.instance),
                (state.facts, checks.fact),
                (state.values, checks.value),
                (state.timed, lambda row: transaction.checked(row.item)),
                (state.goals, lambda row: checks.check_again(checks.goal(row))),
                (state.metric, lambda row: checks.metric(row.metric)),
            )
            for table, check in rules:
                for row in list(table.all()):
                    try:
                        check(row)
                    except UpdateRefused as error:
                        warn(f"the state file has what no planner can read; it is dropped: {error}")
                        transaction.drop(table, row.key)

    # --- changes --------------------------------------------------------------------------------

    def listen(self, callback: Callable[[StateChange], None]) -> None:
        """Calls back after every transaction that changed something, in the order of versions."""
        self._listeners.append(callback)

    @contextmanager
    def transaction(self, client: str = "") -> Iterator[Transaction]:
        """All that is done with the transaction counts together, or not at all when the body raises.

        :raises UpdateRefused: an update is refused; nothing is changed.
        :raises JournalError: the journal cannot be written; nothing is changed.
        """
        with self._lock:
            transaction = Transaction(
                self._state, self._checks, self._clock(), self._passed(), self._next_order
            )
            self._copy = None
            try:
                yield transaction
                transaction.settle()
                if transaction.steps and self._journal is not None:
                    self._journal.commit(transaction.steps, self.version + 1)
            except OSError as error:
                transaction.undo()
                raise JournalError(f"the state file cannot be written: {error}") from error
            except BaseException:
                transaction.undo()
                raise
            changed = bool(transaction.steps or transaction.cleared)
            if changed:
                self.version += 1
                self._next_order = transaction.next_order
                self._queue_timed([step[3] for step in transaction.steps if isinstance(step[3], Timed)])
                self._undelivered.append(transaction.change(self.version, client))
        if changed:
            self._deliver()

    def _deliver(self) -> None:
        # another thread may be publishing this change: its listeners have returned when the lock is free
        with self._delivery:
            while self._undelivered:
                change = self._undelivered.popleft()
                for listener in self._listeners:
                    try:
                        listener(change)
                    except Exception:  # the change counts, and the others have to hear of it
                        log_failure("a listener of the knowledge")

    def load_problem(self, problem: Problem, client: str = "") -> None:
        """Adds everything a problem states. Its timed facts count from now.

        :raises UpdateRefused: it does not fit the domain; nothing is changed.
        """
        with self.transaction(client) as transaction:
            for name, types in problem.objects.items():
                for type_name in types:
                    transaction.add(Instance(type_name, name))
            for fact in problem.facts:
                transaction.add(fact)
            for value in problem.values:
                transaction.add(value)
            for row in problem.timed:
                transaction.add(row.item, transaction.now + row.at)
            for condition in problem.goals:
                transaction.add_goal(StoredGoal(condition))
            if problem.metric is not None:
                transaction.set_metric(problem.metric)

    # --- timed items ----------------------------------------------------------------------------

    def _queue_timed(self, rows: Sequence[Timed]) -> None:
        for row in rows:
            heapq.heappush(self._due, (row.at, row.key))

    def next_due(self) -> Optional[int]:
        """When the next timed item becomes true, ns; None when there is none."""
        with self._lock:
            while self._due and self._state.timed.get(self._due[0][1]) is None:
                heapq.heappop(self._due)
            return self._due[0][0] if self._due else None

    def fire_due(self, client: str = "") -> List[str]:
        """Applies every timed item whose time has come; returns why some could not be applied.

        :raises JournalError: the journal cannot be written; what is due stays due.
        """
        refused: List[str] = []
        while True:
            row: Optional[Timed] = None
            try:
                with self.transaction(client) as transaction:
                    row = self._next_due_row(transaction.now)
                    if row is None:
                        return refused
                    transaction.fire(row)
            except JournalError:
                raise
            except UpdateRefused as error:
                assert row is not None
                with self.transaction(client) as transaction:
                    transaction.drop(self._state.timed, row.key)
                refused.append(f"the timed item {row.item.text()} is dropped: {error}")

    def _next_due_row(self, now: int) -> Optional[Timed]:
        # It stays on the heap: a transaction that is taken back leaves it due.
        at = self.next_due()
        return None if at is None or at > now else self._state.timed.rows[self._due[0][1]]

    # --- reading --------------------------------------------------------------------------------

    def facts(self, name: str = "") -> List[Fact]:
        """Facts of that predicate, or all; in the order in which they came."""
        with self._lock:
            return self._state.facts.named(name.lower()) if name else self._state.facts.all()

    def values(self, name: str = "") -> List[FunctionValue]:
        """Values of that function, or all."""
        with self._lock:
            return self._state.values.named(name.lower()) if name else self._state.values.all()

    def timed(self, name: str = "") -> List[Timed]:
        """Items that wait for their time, of that predicate or function, or all."""
        with self._lock:
            rows = self._state.timed.all()
        return [row for row in rows if not name or getattr(row.item, "name", "").lower() == name.lower()]

    def goals(self) -> List[StoredGoal]:
        """All goals."""
        with self._lock:
            return self._state.goals.all()

    @property
    def metric(self) -> Optional[Metric]:
        """The metric, if one is set."""
        with self._lock:
            row = self._state.metric.get("metric")
            return None if row is None else row.metric

    def instances(self, type_name: str = "", constants: bool = False, subtypes: bool = False) -> List[str]:
        """Names of the objects of a type, each once; an empty type means all, grouped by type.

        Subtypes come before the type itself, and a type's constants after its instances.
        """
        with self._lock:
            types = self.domain.types
            if not type_name:
                wanted = sorted({*self._state.instances.types(), *types})
            elif subtypes:
                lower = type_name.lower()
                below = types.subtypes(lower)
                wanted = [name for name in types if name in below and name != lower] + [lower]
            else:
                wanted = [type_name.lower()]
            found: List[str] = []
            for name in wanted:
                found += [instance.name for instance in self._state.instances.of_type(name)]
                found += self.domain.constants_of(name, subtypes=False) if constants else []
            return list(dict.fromkeys(found))

    def objects(self) -> Dict[str, Tuple[str, ...]]:
        """Every object (lower-case) with its types, constants included."""
        with self._lock:
            return self._state.all_objects()

    def sensed(self, name: str) -> bool:
        """Whether a predicate is kept by the sensing interface."""
        with self._lock:
            return self._state.sensed.get(name.lower()) is not None

    def executions(self, owner: str = "") -> List[OpenExecution]:
        """The executions that are open, oldest first; of one node, or of all."""
        with self._lock:
            return open_executions(self._state, owner)

    def query(
        self, items: Sequence[Union[Item, Condition, None]], between: Callable[[], None] = lambda: None
    ) -> List[bool]:
        """Whether each of the items holds, all at the same moment; None never does.

        :param between: called now and then while an answer takes long; what it raises ends the query.
        """
        long = len(items) > LONG or any(self._searches(item) for item in items)
        with self._lock:
            if not long:
                return [item is not None and self._state.true(item) for item in items]
            if self._copy is None:
                self._copy = self._state.copy()
            state = self._copy
        return [item is not None and state.true(item, between) for item in items]

    def _searches(self, item: Union[Item, Condition, None]) -> bool:
        """Whether the time that an answer takes grows with the number of objects."""
        return any(
            isinstance(part, (Forall, Exists))
            or (isinstance(part, (Atom, Fact)) and part.name.lower() in self.domain.derived)
            for part in walk(item)
        )

    def snapshot(self, name: str = "task") -> Tuple[int, Problem]:
        """Version and everything that is stored, as a problem; timed items by the nanoseconds left."""
        with self._lock:
            now = self._clock()
            objects: Dict[str, Tuple[str, ...]] = {}
            for instance in self._state.instances.all():
                if not self.domain.implies(instance.name, instance.type_name):
                    objects[instance.name] = (*objects.get(instance.name, ()), instance.type_name)
            metric = self._state.metric.get("metric")
            goals = self._state.goals.all()
            problem = Problem(
                name,
                self.domain.name,
                objects,
                self._state.facts.all(),
                self._state.values.all(),
                [Timed(row.at - now, row.item) for row in self._state.timed.all()],
                [goal.condition for goal in goals if goal.condition is not None],
                [goal.instance for goal in goals if goal.instance is not None],
                None if metric is None else metric.metric,
            )
            return self.version, problem

    def close(self) -> None:
        """Closes the journal."""
        with self._lock:
            if self._journal is not None:
                self._journal.close()

# SPDX-License-Identifier: Apache-2.0
"""What the earlier happenings of a plan needed and changed: which of them a later one has to follow."""

from typing import Collection, Dict, FrozenSet, List, Optional, Set

from merlin_pddl.knowledge import Key
from merlin_rosplan.dispatch.operator_model import TimedEffects


class _Run:
    """Consecutive nodes that all want an atom true (or all want it false), in the order of the plan."""

    __slots__ = ("positive", "nodes", "changes")

    def __init__(self, positive: bool) -> None:
        self.positive = positive
        self.nodes: List[int] = []
        self.changes = False  # whether one of them makes it so


class Touched:
    """The nodes that have needed or changed one atom so far."""

    __slots__ = ("runs", "last_adder", "last_deleter", "unchecked")

    def __init__(self) -> None:
        self.runs: List[_Run] = []
        self.unchecked: Set[int] = set()  # nodes that change it, or need it without being checked
        self.last_adder: Optional[int] = None
        self.last_deleter: Optional[int] = None

    def note(self, node: int, positive: bool, changes: bool) -> None:
        """A node needs the atom true or false, or makes it so."""
        if not self.runs or self.runs[-1].positive != positive:
            self.runs.append(_Run(positive))
        self.runs[-1].nodes.append(node)
        self.runs[-1].changes |= changes
        if changes:
            self.unchecked.add(node)
        if changes and positive:
            self.last_adder = node
        elif changes:
            self.last_deleter = node

    def against(self, positive: bool, reduce: bool) -> List[int]:
        """Earlier nodes that a node making the atom `positive` contradicts.

        Reduced: those behind two changes are left out. Each of them precedes the first change, that one the
        second, and the second the node.
        """
        nodes: List[int] = []
        for index in range(len(self.runs) - 1, -1, -1):
            run = self.runs[index]
            if run.positive == positive:
                continue
            nodes.extend(run.nodes)
            if reduce and run.changes and index > 0 and self.runs[index - 1].changes:
                break
        return nodes


class _Batches:
    """Accesses in alternating batches.

    Members of a batch need no order among themselves, and each follows the whole batch before it: two batches
    back follows from that.
    """

    __slots__ = ("kind", "current", "previous")

    def __init__(self) -> None:
        self.kind = ""
        self.current: List[int] = []
        self.previous: List[int] = []

    def join(self, node: int, kind: str) -> List[int]:
        """Adds a node; returns what it follows. An empty kind joins no batch."""
        if not kind or kind != self.kind:
            self.kind, self.previous, self.current = kind, self.current, []
        self.current.append(node)
        return self.previous


class NumberHistory:
    """The nodes that have read or changed one function value so far.

    Reads commute, and so do increases and decreases among themselves (PDDL 2.1, definition 12); an assignment
    commutes with nothing.
    """

    __slots__ = ("_batches", "writer")

    def __init__(self) -> None:
        self._batches = _Batches()
        self.writer: Optional[int] = None  # the last one

    def touch(self, node: int, reads: bool, writes: bool, additive: bool) -> List[int]:
        """A node reads it, changes it, or both; returns the earlier nodes that it has to follow."""
        if writes:
            self.writer = node
        if reads and not writes:
            return self._batches.join(node, "read")
        return self._batches.join(node, "add" if additive and not reads else "")


class Named:
    """The nodes that have touched one predicate or function so far, with whatever arguments.

    Atoms are ordered among themselves by their arguments, elsewhere. Here reads of the whole name (in
    expressions) are ordered with every change, and changes of unknown arguments with everything.
    """

    __slots__ = ("_batches", "_readers", "_changer")

    def __init__(self) -> None:
        self._batches = _Batches()
        self._readers: List[int] = []  # of an atom, since the last change of unknown arguments
        self._changer: List[int] = []  # the last change of unknown arguments

    def read_atom(self, node: int) -> List[int]:
        """A node reads an atom of that name; returns the earlier nodes that it has to follow."""
        self._readers.append(node)
        return self._changer

    def read(self, node: int) -> List[int]:
        """A node reads the whole name."""
        return self._batches.join(node, "read")

    def change_atom(self, node: int) -> List[int]:
        """A node changes an atom of that name."""
        return self._batches.join(node, "change")

    def change(self, node: int) -> List[int]:
        """A node changes what is not known before it runs."""
        found = self._batches.join(node, "") + self._readers
        self._readers, self._changer = [], [node]
        return found


class Constrained:
    """The nodes that have changed what one trajectory constraint reads, by the objects of its `forall`.

    :param reads: one of :attr:`merlin_pddl.domain.Domain.constraints`.
    """

    __slots__ = ("_reads", "_last")

    def __init__(self, reads: FrozenSet[Key]) -> None:
        self._reads = reads
        self._last: Dict[FrozenSet[Key], int] = {}  # by variables with their objects

    def change(self, node: int, effects: TimedEffects) -> List[int]:
        """A node has these ground effects; returns the earlier nodes that it has to follow."""
        bindings = constrained(self._reads, effects)
        found = [last for known, last in self._last.items() if any(_agree(known | each) for each in bindings)]
        self._last.update(dict.fromkeys(bindings, node))
        return found


def constrained(reads: FrozenSet[Key], effects: TimedEffects) -> List[FrozenSet[Key]]:
    """What the variables of a constraint may stand for where it reads what ground effects change.

    :param reads: one of :attr:`merlin_pddl.domain.Domain.constraints`.
    """
    terms = [term.key for term in (*effects.add, *effects.delete, *effects.writes)]
    changed = [(term.name, *term.arguments) for term in terms] + [(name.lower(),) for name in effects.wild]
    possible = (_binding(read, each) for read in reads for each in changed)
    return [binding for binding in possible if binding is not None]


def _binding(read: Key, changed: Key) -> Optional[FrozenSet[Key]]:
    """The variables with their objects; None: something else is read."""
    pairs = [(wanted, value) for wanted, value in zip(read, changed) if wanted != value and wanted]
    if any(not wanted.startswith("?") for wanted, _ in pairs) or not _agree(pairs):
        return None
    return frozenset(pairs)


def _agree(pairs: Collection[Key]) -> bool:
    """Whether each variable stands for one object."""
    return len({pair[0] for pair in pairs}) == len(set(pairs))

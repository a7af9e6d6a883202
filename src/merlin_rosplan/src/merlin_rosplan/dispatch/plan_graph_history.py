# SPDX-License-Identifier: Apache-2.0
"""What the earlier happenings of a plan needed and changed: which of them a later one has to follow."""

from typing import List, Optional, Set


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

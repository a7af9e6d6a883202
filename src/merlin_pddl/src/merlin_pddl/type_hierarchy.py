# SPDX-License-Identifier: Apache-2.0
"""The types of a domain and which of them are kinds of which."""

from typing import Dict, Iterable, Iterator, List, Set, Tuple

OBJECT = "object"


class TypeCycleError(ValueError):
    """A type would be its own ancestor; the text names the cycle."""


class TypeHierarchy:
    """Types in the order of their declaration. `object` is the ancestor of all and need not be declared."""

    def __init__(self) -> None:
        self._parents: Dict[str, Tuple[str, ...]] = {}
        self._below: Dict[str, Set[str]] = {}

    def declare(self, name: str, parents: Iterable[str] = ()) -> None:
        """Adds a type; a second declaration of the same type adds parents."""
        self._parents[name] = tuple(dict.fromkeys((*self._parents.get(name, ()), *parents)))
        self._below.clear()

    def complete(self) -> None:
        """Adds parents that were not declared and checks that no type is its own ancestor.

        :raises TypeCycleError: one is.
        """
        for parents in list(self._parents.values()):
            for parent in parents:
                if parent != OBJECT and parent not in self._parents:
                    self._parents[parent] = ()
        done: Set[str] = set()
        for start in self._parents:
            self._visit(start, done)

    def _visit(self, start: str, done: Set[str]) -> None:
        stack: List[Tuple[str, Iterator[str]]] = [(start, iter(self._parents.get(start, ())))]
        while stack:
            path, parents = [name for name, _ in stack], stack[-1][1]
            parent = next(parents, None)
            if parent is None:
                stack.pop()
                done.add(path[-1])
            elif parent in path:
                cycle = [*path[path.index(parent) :], parent]
                raise TypeCycleError(f"the type '{parent}' is its own ancestor: {' - '.join(cycle)}")
            elif parent not in done:
                stack.append((parent, iter(self._parents.get(parent, ()))))

    def __contains__(self, name: str) -> bool:
        return name == OBJECT or name in self._parents

    def __iter__(self) -> Iterator[str]:
        return iter(self._parents)

    def parents(self, name: str) -> Tuple[str, ...]:
        """The parents as declared: empty when none is written."""
        return self._parents.get(name, ())

    def subtypes(self, name: str) -> Set[str]:
        """The type and everything below it."""
        if name not in self._below:
            more = found = set(self._parents) | {OBJECT} if name == OBJECT else {name}
            while more:
                more = {t for t, parents in self._parents.items() if t not in found and more & set(parents)}
                found = found | more
            self._below[name] = found
        return self._below[name]

    def ancestors(self, name: str) -> List[str]:
        """The type, its parents and theirs, the nearest first; always ends with `object`."""
        found = [name]
        for current in found:
            found.extend(p for p in self.parents(current) if p not in found)
        return [t for t in found if t != OBJECT] + [OBJECT]

    def is_a(self, name: str, ancestor: str) -> bool:
        """Whether `name` is `ancestor` or below it."""
        return ancestor == OBJECT or name in self.subtypes(ancestor)

    def overlap(self, some: Iterable[str], others: Iterable[str]) -> bool:
        """Whether there may be an object of one of `some` and of one of `others`."""
        listed = list(others)
        return any(self.subtypes(one) & self.subtypes(other) for one in some for other in listed)

    def common(self, names: Iterable[str]) -> str:
        """The nearest type that covers all the named ones."""
        listed = list(names)
        if not listed:
            return OBJECT
        for candidate in self.ancestors(listed[0]):
            if all(self.is_a(name, candidate) for name in listed):
                return candidate
        return OBJECT

    def most_specific(self, names: Iterable[str]) -> List[str]:
        """The named types without those that another of them already implies."""
        listed = list(dict.fromkeys(names))
        return [n for n in listed if not any(o != n and self.is_a(o, n) for o in listed)]

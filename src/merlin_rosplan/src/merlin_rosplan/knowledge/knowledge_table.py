# SPDX-License-Identifier: Apache-2.0
"""Ordered tables with undo, and the index that finds facts by name and by argument without scanning.

An index is made when something is first asked of it, and kept up from then on: after a restart a knowledge
base answers before 100 000 facts are indexed, and a copy that is only evaluated costs no more than its rows.
"""

from typing import Any, Callable, Dict, Generic, Iterable, Iterator, List, Optional, Sequence, Tuple, TypeVar

from merlin_pddl.knowledge import Instance, Key, Row

R = TypeVar("R", bound=Row)
T = TypeVar("T", bound="Table[Any]")
Keys = Dict[Key, None]  # a set that keeps its order


class Index:
    """Keys by what stands in them.

    Of rows that do not change any number of threads may ask at once: two that make the index make it twice,
    and either one is whole when it is seen.

    :param entries: what a key is found by.
    """

    def __init__(self, entries: Callable[[Key], Iterable[Any]]) -> None:
        self._entries = entries
        self._found: Optional[Dict[Any, Keys]] = None  # None: not made yet

    def of(self, rows: Iterable[Key]) -> Dict[Any, Keys]:
        """The keys of the table's rows, by each entry."""
        found = self._found
        if found is None:
            found = {}
            for key in rows:
                for entry in self._entries(key):
                    found.setdefault(entry, {})[key] = None
            self._found = found
        return found

    def enter(self, key: Key) -> None:
        """A new key."""
        if self._found is not None:
            for entry in self._entries(key):
                self._found.setdefault(entry, {})[key] = None

    def leave(self, key: Key) -> None:
        """A key that is gone."""
        if self._found is not None:
            for entry in self._entries(key):
                keys = self._found.get(entry, {})
                keys.pop(key, None)
                if not keys:
                    self._found.pop(entry, None)

    def forget(self) -> None:
        """Everything is new."""
        self._found = None


class Table(Generic[R]):
    """Rows by key, in the order in which they came.

    A row keeps its place when another one takes over its key. Not thread-safe: the store locks.

    :param indexes: that it keeps up.
    """

    def __init__(self, kind: str, *indexes: Index) -> None:
        self.kind = kind
        self.rows: Dict[Any, R] = {}
        self._indexes = indexes

    def get(self, key: Any) -> Optional[R]:
        """The row of a key."""
        return self.rows.get(key)

    def put(self, key: Any, row: R) -> None:
        """Stores a row."""
        if key not in self.rows:
            for index in self._indexes:
                index.enter(key)
        self.rows[key] = row

    def remove(self, key: Any) -> None:
        """Drops an existing row."""
        del self.rows[key]
        for index in self._indexes:
            index.leave(key)

    def load(self, rows: Sequence[R]) -> None:
        """Stores the rows of an empty table, in their order."""
        self.swap({row.key: row for row in rows})

    def copy(self: T) -> T:
        """A table with the same rows, for reading beside this one."""
        twin = type(self)(self.kind)
        twin.rows = self.rows.copy()
        return twin

    def swap(self, rows: Dict[Any, R]) -> Dict[Any, R]:
        """Exchanges the whole content; returns the old one."""
        old, self.rows = self.rows, rows
        for index in self._indexes:
            index.forget()
        return old

    def sort(self) -> None:
        """Restores the order after rows came back."""
        self.swap(dict(sorted(self.rows.items(), key=lambda entry: entry[1].order)))

    def all(self) -> List[R]:
        """All rows."""
        return list(self.rows.values())


class ArgumentTable(Table[R]):
    """A table whose keys are (name, argument, ...), indexed by name and by each argument's position."""

    def __init__(self, kind: str) -> None:
        self._by_name = Index(lambda key: key[:1])
        self._by_place = Index(lambda key: [(key[0], place, key[place]) for place in range(1, len(key))])
        self._by_object = Index(lambda key: key[1:])
        super().__init__(kind, self._by_name, self._by_place, self._by_object)

    def _names(self) -> Dict[str, Keys]:
        return self._by_name.of(self.rows)

    def named(self, name: str) -> List[R]:
        """Rows of a name (lower-case)."""
        return [self.rows[key] for key in self._names().get(name, ())]

    def mentioning(self, obj: str) -> List[Key]:
        """Keys with that object (lower-case) among the arguments."""
        return list(self._by_object.of(self.rows).get(obj, ()))

    def first(self, key: Key) -> Optional[R]:
        """The row of a key; where words of it are empty, the first one that fits."""
        return self.rows.get(key if "" not in key else next(self.match(key[0], key[1:]), None))

    def match(self, name: str, args: Sequence[str]) -> Iterator[Key]:
        """Keys that fit (all lower-case): an empty name fits everything, an empty argument any object.

        The table must not change before the iterator is used up.
        """
        if not name:
            yield from self.rows
            return
        given = [(place, arg) for place, arg in enumerate(args, 1) if arg]
        if len(given) == len(args):
            key = (name, *args)
            if key in self.rows:
                yield key
            return
        smallest = self._names().get(name, {})
        for place, arg in given:
            keys = self._by_place.of(self.rows).get((name, place, arg), {})
            if len(keys) < len(smallest):
                smallest = keys
        length = len(args) + 1
        for key in smallest:
            if len(key) == length and all(key[place] == arg for place, arg in given):
                yield key


class InstanceTable(Table[Instance]):
    """Instances by (type, name), indexed by type and by name."""

    def __init__(self, kind: str) -> None:
        self._by_type, self._by_name = Index(lambda key: key[:1]), Index(lambda key: key[1:])
        super().__init__(kind, self._by_type, self._by_name)

    def _made(self) -> Tuple[Dict[str, Keys], Dict[str, Keys]]:
        return self._by_type.of(self.rows), self._by_name.of(self.rows)

    def types(self) -> List[str]:
        """Types (lower-case) that have instances."""
        return list(self._made()[0])

    def of_type(self, type_name: str) -> List[Instance]:
        """Instances of exactly that type (lower-case)."""
        return [self.rows[key] for key in self._made()[0].get(type_name, ())]

    def named(self, name: str) -> List[Instance]:
        """The instances that one object (lower-case) is: one for each of its types."""
        return [self.rows[key] for key in self._made()[1].get(name, ())]

    def spelling(self, name: str) -> Optional[str]:
        """An object (lower-case) as it was first written; None when it is unknown."""
        keys = self._made()[1].get(name)
        return None if not keys else self.rows[next(iter(keys))].name

# SPDX-License-Identifier: Apache-2.0
"""Ordered tables with undo, and the index that finds facts by name and by argument without scanning.

An index is made when something is first asked of it, and kept up from then on: after a restart a knowledge
base answers before 100 000 facts are indexed, and a copy that is only evaluated costs no more than its rows.
"""

from typing import Any, Callable, Dict, Generic, Iterator, List, Optional, Sequence, Tuple, TypeVar

from merlin_pddl.knowledge import Instance, Key, Row

R = TypeVar("R", bound=Row)
T = TypeVar("T", bound="Table[Any]")


class Table(Generic[R]):
    """Rows by key, in the order in which they came.

    A row keeps its place when another one takes over its key. Not thread-safe: the store locks.
    """

    def __init__(self, kind: str) -> None:
        self.kind = kind
        self.rows: Dict[Any, R] = {}

    def get(self, key: Any) -> Optional[R]:
        """The row of a key."""
        return self.rows.get(key)

    def put(self, key: Any, row: R) -> None:
        """Stores a row."""
        if key not in self.rows:
            self._enter(key)
        self.rows[key] = row

    def remove(self, key: Any) -> None:
        """Drops an existing row."""
        del self.rows[key]
        self._leave(key)

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
        self._forget()
        return old

    def sort(self) -> None:
        """Restores the order after rows came back."""
        self.swap(dict(sorted(self.rows.items(), key=lambda entry: entry[1].order)))

    def all(self) -> List[R]:
        """All rows."""
        return list(self.rows.values())

    def _enter(self, key: Any) -> None:
        """For indexes: a new key."""

    def _leave(self, key: Any) -> None:
        """For indexes: a key that is gone."""

    def _forget(self) -> None:
        """For indexes: everything is new."""


Keys = Dict[Key, None]  # a set that keeps its order


def _add(index: Dict[Any, Keys], entry: Any, key: Key) -> None:
    keys = index.get(entry)
    if keys is None:
        index[entry] = {key: None}
    else:
        keys[key] = None


def _drop(index: Dict[Any, Keys], entry: Any, key: Key) -> None:
    keys = index.get(entry)
    if keys is not None:
        keys.pop(key, None)
        if not keys:
            del index[entry]


class ArgumentTable(Table[R]):
    """A table whose keys are (name, argument, ...), indexed by name and by each argument's position.

    Of a table that does not change any number of threads may ask at once: two that make the same index make
    it twice, and either one is whole when it is seen.
    """

    def __init__(self, kind: str) -> None:
        super().__init__(kind)
        self._forget()

    def _forget(self) -> None:
        self._by_name: Optional[Dict[str, Keys]] = None
        self._by_place: Optional[Dict[Tuple[str, int, str], Keys]] = None
        self._by_object: Optional[Dict[str, Keys]] = None

    def _enter(self, key: Key) -> None:
        self._change(key, _add)

    def _leave(self, key: Key) -> None:
        self._change(key, _drop)

    def _change(self, key: Key, change: Callable[[Dict[Any, Keys], Any, Key], None]) -> None:
        if self._by_name is not None:
            change(self._by_name, key[0], key)
        if self._by_place is not None:
            for place in range(1, len(key)):
                change(self._by_place, (key[0], place, key[place]), key)
        if self._by_object is not None:
            for place in range(1, len(key)):
                change(self._by_object, key[place], key)

    def _names(self) -> Dict[str, Keys]:
        index = self._by_name
        if index is None:
            index = {}
            for key in self.rows:
                _add(index, key[0], key)
            self._by_name = index
        return index

    def _places(self) -> Dict[Tuple[str, int, str], Keys]:
        index = self._by_place
        if index is None:
            index = {}
            for key in self.rows:
                for place in range(1, len(key)):
                    _add(index, (key[0], place, key[place]), key)
            self._by_place = index
        return index

    def named(self, name: str) -> List[R]:
        """Rows of a name (lower-case)."""
        return [self.rows[key] for key in self._names().get(name, ())]

    def mentioning(self, obj: str) -> List[Key]:
        """Keys with that object (lower-case) among the arguments."""
        index = self._by_object
        if index is None:
            index = {}
            for key in self.rows:
                for arg in key[1:]:
                    _add(index, arg, key)
            self._by_object = index
        return list(index.get(obj, ()))

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
            keys = self._places().get((name, place, arg), {})
            if len(keys) < len(smallest):
                smallest = keys
        length = len(args) + 1
        for key in smallest:
            if len(key) == length and all(key[place] == arg for place, arg in given):
                yield key


class InstanceTable(Table[Instance]):
    """Instances by (type, name), indexed by type and by name."""

    def __init__(self, kind: str) -> None:
        super().__init__(kind)
        self._forget()

    def _forget(self) -> None:
        self._indexes: Optional[Tuple[Dict[str, Keys], Dict[str, Keys]]] = None

    def _enter(self, key: Key) -> None:
        for index, entry in zip(self._indexes or (), key):
            _add(index, entry, key)

    def _leave(self, key: Key) -> None:
        for index, entry in zip(self._indexes or (), key):
            _drop(index, entry, key)

    def _made(self) -> Tuple[Dict[str, Keys], Dict[str, Keys]]:
        """By type and by name."""
        if self._indexes is None:
            by_type: Dict[str, Keys] = {}
            by_name: Dict[str, Keys] = {}
            for key in self.rows:
                _add(by_type, key[0], key)
                _add(by_name, key[1], key)
            self._indexes = by_type, by_name
        return self._indexes

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

"""Ordered tables with undo, and the index that finds facts by name and by argument without scanning."""

from typing import Any, Dict, Generic, Iterable, Iterator, List, Optional, Sequence, Tuple, TypeVar

from merlin_rosplan.knowledge import Instance, Key, Row

R = TypeVar("R", bound=Row)


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
        """Drops a row that is there."""
        del self.rows[key]
        self._leave(key)

    def swap(self, rows: Dict[Any, R]) -> Dict[Any, R]:
        """Exchanges the whole content; returns the old one."""
        old, self.rows = self.rows, rows
        self._rebuild()
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

    def _rebuild(self) -> None:
        """For indexes: everything is new."""


Keys = Dict[Key, None]  # a set that keeps its order


class ArgumentTable(Table[R]):
    """A table whose keys are (name, argument, ...), indexed by name and by each argument's position."""

    def __init__(self, kind: str) -> None:
        super().__init__(kind)
        self._by_name: Dict[str, Keys] = {}
        self._by_place: Dict[Tuple[str, int, str], Keys] = {}
        self._by_object: Dict[str, Keys] = {}

    def _indexes(self, key: Key) -> Iterable[Tuple[Dict[Any, Keys], Any]]:
        name = key[0]
        yield self._by_name, name
        for place in range(1, len(key)):
            yield self._by_place, (name, place, key[place])
            yield self._by_object, key[place]

    def _enter(self, key: Key) -> None:
        for index, entry in self._indexes(key):
            keys = index.get(entry)
            if keys is None:
                index[entry] = {key: None}
            else:
                keys[key] = None

    def _leave(self, key: Key) -> None:
        for index, entry in self._indexes(key):
            keys = index.get(entry)
            if keys is not None:
                keys.pop(key, None)
                if not keys:
                    del index[entry]

    def _rebuild(self) -> None:
        self._by_name, self._by_place, self._by_object = {}, {}, {}
        for key in self.rows:
            self._enter(key)

    def named(self, name: str) -> List[R]:
        """Rows of a name (lower-case)."""
        return [self.rows[key] for key in self._by_name.get(name, ())]

    def mentioning(self, obj: str) -> List[Key]:
        """Keys with that object (lower-case) among the arguments."""
        return list(self._by_object.get(obj, ()))

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
        smallest = self._by_name.get(name, {})
        for place, arg in given:
            keys = self._by_place.get((name, place, arg), {})
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
        self._by_type: Dict[str, Keys] = {}
        self._by_name: Dict[str, Keys] = {}

    def _enter(self, key: Key) -> None:
        self._by_type.setdefault(key[0], {})[key] = None
        self._by_name.setdefault(key[1], {})[key] = None

    def _leave(self, key: Key) -> None:
        for index, entry in ((self._by_type, key[0]), (self._by_name, key[1])):
            index[entry].pop(key, None)
            if not index[entry]:
                del index[entry]

    def _rebuild(self) -> None:
        self._by_type, self._by_name = {}, {}
        for key in self.rows:
            self._enter(key)

    def types(self) -> List[str]:
        """Types (lower-case) that have instances."""
        return list(self._by_type)

    def of_type(self, type_name: str) -> List[Instance]:
        """Instances of exactly that type (lower-case)."""
        return [self.rows[key] for key in self._by_type.get(type_name, ())]

    def named(self, name: str) -> List[Instance]:
        """The instances that one object (lower-case) is: one for each of its types."""
        return [self.rows[key] for key in self._by_name.get(name, ())]

    def spelling(self, name: str) -> Optional[str]:
        """An object (lower-case) as it was first written; None when there is none."""
        keys = self._by_name.get(name)
        return None if not keys else self.rows[next(iter(keys))].name

# SPDX-License-Identifier: Apache-2.0
"""A set that keeps the order in which its members came: structure messages are the same everywhere."""

from typing import Any, Dict, Hashable, Iterable, Iterator, MutableSet, Optional, Tuple


class OrderedSet(MutableSet[Any]):
    """A set with the order of insertion.

    :param items: the first members.
    """

    __slots__ = ("_items", "_tuple")

    def __init__(self, items: Iterable[Any] = ()) -> None:
        self._items: Dict[Any, None] = dict.fromkeys(items)
        self._tuple: Optional[Tuple[Any, ...]] = None

    def as_tuple(self) -> Tuple[Any, ...]:
        """The members; kept, for states are asked for them at each transition."""
        if self._tuple is None:
            self._tuple = tuple(self._items)
        return self._tuple

    def __contains__(self, item: object) -> bool:
        return isinstance(item, Hashable) and item in self._items

    def __iter__(self) -> Iterator[Any]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)

    def add(self, item: Any) -> None:
        """Adds a member at the end, unless it is one."""
        self._items[item] = None
        self._tuple = None

    def discard(self, item: Any) -> None:
        """Removes a member if it is one."""
        self._items.pop(item, None)
        self._tuple = None

    def update(self, items: Iterable[Any]) -> None:
        """Adds several members."""
        self._items.update(dict.fromkeys(items))
        self._tuple = None

    def __repr__(self) -> str:
        return f"OrderedSet({list(self._items)!r})"

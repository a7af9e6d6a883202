# SPDX-License-Identifier: Apache-2.0
"""The state that is shown: a tree of plain values, and feeds of what changed in it.

A change is a path and its new value, or a path alone for what is gone. A reader that is slower than the state
changes misses nothing and stores little: of several changes of one path only the last is kept, and beyond
a limit the whole state takes their place.
"""

import json
import threading
from typing import Any, Callable, Dict, Iterable, List, Mapping, NamedTuple, Optional, Sequence, Tuple

from merlin_monitor.text.plain_value import LONGEST_KEY, plain, plain_text

Path = Tuple[str, ...]
MOST_CHANGES = 2000  # that a feed keeps; more become one whole state
#: In place of a value: the path was removed.
GONE: Any = object()


class ChangeSet:
    """Changes since a feed was last read, the last one of each path, in an order that can be replayed."""

    def __init__(self) -> None:
        self.whole = False
        self._changes: Dict[Path, Any] = {}
        self._depths: Dict[int, int] = {}  # length of path → how many

    def __bool__(self) -> bool:
        return self.whole or bool(self._changes)

    def add(self, path: Path, value: Any) -> None:
        """Notes a change; what it makes superfluous is forgotten."""
        if self.whole:
            return
        self._discard(path)
        if any(depth > len(path) for depth in self._depths):
            for below in [known for known in self._changes if known[: len(path)] == path]:
                self._discard(below)
        self._changes[path] = value
        self._depths[len(path)] = self._depths.get(len(path), 0) + 1
        if len(self._changes) > MOST_CHANGES:
            self.become_whole()

    def merge(self, other: "ChangeSet") -> None:
        """Adds later changes."""
        if other.whole:
            self.become_whole()
        for path, value in other._changes.items():
            self.add(path, value)

    def become_whole(self) -> None:
        """Everything has changed."""
        self.whole = True
        self._changes.clear()
        self._depths.clear()

    def as_list(self) -> List[List[Any]]:
        """``[path, value]`` for what is new, ``[path]`` for what is gone."""
        return [
            [list(path)] if value is GONE else [list(path), value] for path, value in self._changes.items()
        ]

    def _discard(self, path: Path) -> None:
        if self._changes.pop(path, self) is not self:
            self._depths[len(path)] -= 1
            if not self._depths[len(path)]:
                del self._depths[len(path)]


class Taken(NamedTuple):
    """What a feed had: the version it leads to and the changes."""

    version: int
    changes: ChangeSet


class Feed:
    """What changed since :meth:`take` was last called.

    :param wake: called once when the first change after that arrives, in the changing thread; must not block.
    """

    def __init__(self, tree: "StateTree", wake: Callable[[], object]) -> None:
        self._tree = tree
        self._wake = wake
        self._changes = ChangeSet()

    def take(self) -> Taken:
        """The changes, which the feed forgets."""
        with self._tree._lock:
            taken = Taken(self._tree.version, self._changes)
            self._changes = ChangeSet()
            return taken

    def close(self) -> None:
        """Ends the feed."""
        with self._tree._lock:
            if self in self._tree._feeds:
                self._tree._feeds.remove(self)

    def _note(self, path: Path, value: Any) -> None:
        asleep = not self._changes
        self._changes.add(path, value)
        if asleep:
            self._wake()


class StateTree:
    """Nested dicts of plain values, with a version that counts the changes. Safe between threads.

    :param sections: names of the dicts at the root.
    """

    def __init__(self, sections: Tuple[str, ...] = ()) -> None:
        self.version = 0
        self._lock = threading.Lock()  # guards all fields, and those of the feeds
        self._root: Dict[str, Any] = {section: {} for section in sections}
        self._feeds: List[Feed] = []

    def set(self, *path_and_value: Any) -> bool:
        """``set("plan", "steps", "3", value)``; whether that changed anything.

        Dicts on the way are made. The value becomes the tree's own.
        """
        return self._set_all(path_and_value[:-2], {path_and_value[-2]: path_and_value[-1]})

    def put(self, *path: str, **fields: Any) -> bool:
        """``put("now", state=state, tone=tone)``: at once, so that no reader has only some of them."""
        return self._set_all(path, fields)

    def _set_all(self, path: Sequence[str], given: Mapping[str, Any]) -> bool:
        fields = plain(given)
        path = tuple(plain_text(part, LONGEST_KEY) for part in path)
        with self._lock:
            changed = [self._set((*path, name), value) for name, value in fields.items()]
            return any(changed)

    def _set(self, path: Path, value: Any) -> bool:
        parent = self._root
        for part in path[:-1]:
            child: Any = parent.get(part)
            if not isinstance(child, dict):
                child = parent[part] = {}
            parent = child
        if path[-1] in parent and parent[path[-1]] == value:
            return False
        parent[path[-1]] = value
        # Feeds pass the value on later; a dict may be changed in place until then.
        self._changed(path, _copy(value))
        return True

    def remove(self, *path: str) -> bool:
        """Removes a path from the tree; returns whether it existed."""
        path = tuple(plain_text(part, LONGEST_KEY) for part in path)
        with self._lock:
            parent = self._at(path[:-1])
            if not isinstance(parent, dict) or path[-1] not in parent:
                return False
            del parent[path[-1]]
            self._changed(path, GONE)
            return True

    def get(self, *path: str, default: Any = None) -> Any:
        """A copy of the value at a path."""
        with self._lock:
            return _copy(self._at(path, default))

    def keys(self, *path: str) -> List[str]:
        """Names below a path."""
        with self._lock:
            value = self._at(path)
            return list(value) if isinstance(value, dict) else []

    def _at(self, path: Sequence[str], default: Any = None) -> Any:
        value: Any = self._root
        for part in path:
            if not isinstance(value, dict) or part not in value:
                return default
            value = value[part]
        return value

    def snapshot(self) -> Tuple[int, Dict[str, Any]]:
        """The version and a copy of the whole state."""
        with self._lock:
            return self.version, _copy(self._root)

    def as_json(self, without: Tuple[str, ...] = ()) -> Tuple[int, str]:
        """The version and the whole state as JSON text.

        :param without: sections that are left out.
        """
        with self._lock:
            shown = {name: section for name, section in self._root.items() if name not in without}
            return self.version, json.dumps(shown, separators=(",", ":"))

    def subscribe(self, wake: Callable[[], object]) -> Feed:
        """A feed of all changes from now on."""
        feed = Feed(self, wake)
        with self._lock:
            self._feeds.append(feed)
        return feed

    def _changed(self, path: Path, value: Any) -> None:
        self.version += 1
        for feed in self._feeds:
            feed._note(path, value)


def apply_changes(
    state: Dict[str, Any], changes: Iterable[Sequence[Any]], own: Optional[Dict[int, Any]] = None
) -> None:
    """Brings a state up to date, as the page does. What it shares, and the changes, stay as they are.

    :param own: for the next changes of the same state: its parts that are shared with none, by id.
    """
    own = {} if own is None else own
    for path, *value in changes:
        parent = state
        for part in path[:-1]:
            child: Any = parent.get(part)
            if id(child) not in own:
                # Also for what is gone: it may have been all that its parent was made for.
                child = parent[part] = dict(child) if isinstance(child, dict) else {}
                own[id(child)] = child
            parent = child
        if value:
            parent[path[-1]] = value[0]
        else:
            parent.pop(path[-1], None)


def _copy(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _copy(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_copy(item) for item in value]
    return value

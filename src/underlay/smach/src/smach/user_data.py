# SPDX-License-Identifier: Apache-2.0
"""Userdata: what the states of a container share."""

import contextlib
import copy
import threading
from typing import Any, Dict, Iterable, Iterator, List, Mapping, Optional, Set

import smach
from smach.exceptions import InvalidUserCodeError
from smach.execution import run_context
from smach.labels import text_of
from smach.read_only import read_only, unwrap

_strict = True


class MissingKeyError(KeyError, AttributeError):
    """A userdata key that was never set; both kinds of error, for it is read both ways."""

    def __str__(self) -> str:
        return str(self.args[0]) if self.args else ""


def set_strict_userdata(strict: bool) -> None:
    """Chooses what happens when a state writes a key that it has not declared as an output key.

    :param strict: True (default): InvalidUserCodeError. False, as in SMACH: an error log, the value is lost.
    """
    global _strict
    _strict = strict


class UserData:
    """The keys and values of a container, read and written as attributes or as items.

    Every single operation is atomic; :meth:`locked` makes several of them so.
    """

    def __init__(self) -> None:
        self._data: Dict[str, Any] = {}
        self._lock = threading.RLock()  # guards all fields
        self._in_run = False
        self._of_run: Set[str] = set()  # keys that came to be in the current or the last run

    @contextlib.contextmanager
    def locked(self) -> Iterator["UserData"]:
        """Holds the lock, for reading and writing in one go."""
        with self._lock:
            yield self

    def keys(self) -> List[str]:
        """The keys that have a value."""
        with self._lock:
            return list(self._data)

    def update(self, ud: Any) -> None:
        """Takes over all keys of another UserData (or mapping)."""
        source = getattr(ud, "_data", ud)
        lock = getattr(ud, "_lock", contextlib.nullcontext())
        with lock:
            values = dict(source)
        with self._lock:
            for key, value in values.items():
                self[key] = value

    def extract(self, keys: Iterable[str], remapping: Mapping[str, str]) -> "UserData":
        """A new UserData with shallow copies of the given keys, renamed.

        :param remapping: new name of a key -> its name here.
        """
        ud = UserData()
        for key in keys:
            ud[key] = copy.copy(self[dict(remapping).get(key, key)])
        return ud

    def merge(self, ud: "UserData", keys: Iterable[str], remapping: Mapping[str, str]) -> None:
        """Takes over shallow copies of keys of another UserData, renamed.

        :param remapping: name of a key there -> its name here.
        """
        for key in keys:
            self[dict(remapping).get(key, key)] = copy.copy(ud[key])

    def __getitem__(self, key: str) -> Any:
        with self._lock:
            try:
                return self._data[key]
            except KeyError:
                known = ", ".join(sorted(map(text_of, self._data))) or "none"
        hint = f"; {_item(key)}, as attribute it is not one" if key in vars(self) else ""
        raise MissingKeyError(f"userdata has no key '{text_of(key)}'; its keys: {known}{hint}")

    def __setitem__(self, key: str, value: Any) -> None:
        # A thread that writes while the container runs is not part of that run.
        self._put(key, value, self._in_run and run_context.executing())

    def __delitem__(self, key: str) -> None:
        with self._lock:
            self[key]
            del self._data[key]

    def __contains__(self, key: object) -> bool:
        with self._lock:
            return key in self._data

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(f"{type(self).__name__} has no attribute '{name}'; {_item(name)}")
        return self[name]

    def __setattr__(self, name: str, value: Any) -> None:
        if name.startswith("_"):
            object.__setattr__(self, name, value)
        else:
            self[name] = value

    def __delattr__(self, name: str) -> None:
        if name.startswith("_"):
            object.__delattr__(self, name)
        else:
            del self[name]

    def __getstate__(self) -> Dict[str, Any]:
        with self._lock:
            return {"_data": dict(self._data), "_of_run": set(self._of_run)}

    def __setstate__(self, state: Dict[str, Any]) -> None:
        self.__init__()  # type: ignore[misc]
        self._data.update(state["_data"])
        self._of_run.update(state["_of_run"])

    def _put(self, key: str, value: Any, of_run: bool) -> None:
        """Sets a value.

        :param of_run: it belongs to the current run; if it has made the key, that ends with it.
        """
        with self._lock:
            if not of_run:
                self._of_run.discard(key)
            elif key not in self._data:
                self._of_run.add(key)
            self._data[key] = value

    def _begin_run(self, keep: bool = False) -> None:
        """A run of the container begins: what only the last run left behind goes.

        :param keep: leave it.
        """
        with self._lock:
            if not keep:
                self._forget(list(self._of_run))
            self._in_run = True

    def _forget(self, keys: Iterable[str]) -> None:
        """Drops those of the keys that only a run brought about."""
        with self._lock:
            for key in self._of_run.intersection(keys):
                self._data.pop(key, None)
                self._of_run.discard(key)

    def _end_run(self) -> None:
        with self._lock:
            self._in_run = False


class Remapper:
    """The view of a container's userdata that a state gets: its declared keys, under its own names.

    :param ud: of the container.
    :param input_keys: keys the state may read.
    :param output_keys: keys the state may write.
    :param remapping: the state's key -> the container's key.
    :param constants: container's key -> value that the state reads in place of the container's.
    """

    __slots__ = ("_constants", "_input_keys", "_map", "_output_keys", "_ud")

    def __init__(
        self,
        ud: Any,
        input_keys: Iterable[str] = (),
        output_keys: Iterable[str] = (),
        remapping: Optional[Mapping[str, str]] = None,
        constants: Optional[Mapping[str, Any]] = None,
    ) -> None:
        put = object.__setattr__
        put(self, "_ud", ud)
        put(self, "_input_keys", input_keys if isinstance(input_keys, tuple) else tuple(input_keys))
        put(self, "_output_keys", output_keys if isinstance(output_keys, tuple) else tuple(output_keys))
        put(self, "_map", dict(remapping) if remapping else {})
        put(self, "_constants", dict(constants) if constants else {})

    def __getitem__(self, key: str) -> Any:
        if key not in self._input_keys:
            raise InvalidUserCodeError(
                f"Reading userdata key '{text_of(key)}', which the state does not declare as an input key; "
                f"declared: {list(self._input_keys)}"
            )
        mapped = self._map.get(key, key)
        value = self._constants[mapped] if mapped in self._constants else self._ud[mapped]
        return value if key in self._output_keys else read_only(value)

    def __setitem__(self, key: str, value: Any) -> None:
        if key not in self._output_keys:
            text = (
                f"Writing userdata key '{text_of(key)}', which the state does not declare as an output key; "
                f"declared: {list(self._output_keys)}"
            )
            if _strict:
                raise InvalidUserCodeError(text)
            smach.logerr(text)
            return
        mapped = self._map.get(key, key)
        self._constants.pop(mapped, None)
        if isinstance(self._ud, UserData):
            self._ud._put(mapped, unwrap(value), of_run=True)  # whichever thread of the state writes
        else:
            self._ud[mapped] = unwrap(value)

    def __contains__(self, key: object) -> bool:
        mapped = self._map.get(key, key)
        return key in self._input_keys and (mapped in self._constants or mapped in self._ud)

    def keys(self) -> List[str]:
        """The declared input keys that have a value, by the state's names."""
        return [key for key in self._input_keys if key in self]

    def update(self, ud: Any) -> None:
        """Writes all keys of another UserData (or mapping); each must be an output key."""
        for key in ud.keys():  # noqa: SIM118 a UserData is not iterable
            self[key] = ud[key]

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(f"{type(self).__name__} has no attribute '{name}'; {_item(name)}")
        return self[name]

    def __setattr__(self, name: str, value: Any) -> None:
        if name.startswith("_"):
            raise AttributeError(f"{type(self).__name__}: {_item(name)}")
        self[name] = value


def _item(name: str) -> str:
    return f"a userdata key that begins with '_' is read and written as an item: userdata['{name}']"

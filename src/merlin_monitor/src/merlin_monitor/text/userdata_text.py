# SPDX-License-Identifier: Apache-2.0
"""Userdata of a state machine as text, read from its pickle without making a single object of it.

A pickle is a program: unpickling runs what it names. Here the standard library's unpickler gets a stub for
everything that a pickle names, so nothing of it is imported or called.
"""

import base64
import binascii
import io
import pickle
from typing import Any, Callable, ClassVar, Dict, List, Tuple

from merlin_ros.work.threads import failure_text

LONGEST = 256 * 1024  # bytes of pickle that are read
LONGEST_VALUE = 600  # characters shown of one value
_SETS = ("builtins.set", "builtins.frozenset")


class UserDataTextError(ValueError):
    """Userdata that cannot be shown, with the reason."""


class _Stub:
    """Takes the place of an object: its arguments, its items and its state instead of what they would do.

    Each name of a pickle gets a subclass of its own, which is gone with the pickle: what a pickle does to the
    class of an object cannot reach another one.
    """

    name = ""
    arguments: List[Any]
    state: Any

    def __new__(cls, *arguments: Any, **more: Any) -> "_Stub":
        stub = super().__new__(cls)
        stub.arguments = [*arguments, *more.values()]
        stub.state = None
        return stub

    def __setstate__(self, state: Any) -> None:
        self.state = state

    def append(self, item: Any) -> None:
        """Adds an item to a list or a set."""
        self.arguments.append(item)


def _stub_class(name: str) -> type:
    return type("Stub", (_Stub,), {"name": name})


def userdata_rows(text: str) -> List[Tuple[str, str]]:
    """Key and value, as texts, of ``local_data``.

    :raises UserDataTextError: when it is not a pickle of a dict.
    """
    if not text:
        return []
    data = _bytes(text)
    if len(data) > LONGEST:
        raise UserDataTextError(f"userdata of {len(data)} bytes is too long to be shown")
    try:
        values = _Reader(io.BytesIO(data), encoding="latin-1").load()
    except Exception as error:  # hostile bytes find every way to fail
        raise UserDataTextError(f"userdata is not a pickle: {failure_text(error)}") from error
    if not isinstance(values, dict):
        raise UserDataTextError("userdata is not a dict")
    return sorted((_show(key, 80).strip("'"), _show(value, LONGEST_VALUE)) for key, value in values.items())


def _bytes(text: str) -> bytes:
    try:
        return base64.b64decode(text.encode("ascii"), validate=True)
    except (UnicodeEncodeError, binascii.Error):
        return text.encode("latin-1", "replace")  # before SMACH 2.5 the pickle itself


class _Reader(pickle._Unpickler):
    """The unpickler written in Python, whose steps can be replaced one by one.

    Replaced is also what hashes: the hash of tuples that share their parts takes time without end.
    """

    dispatch: ClassVar[Dict[int, Callable[[Any], None]]] = dict(pickle._Unpickler.dispatch)
    # Of the base class, whose types do not name them.
    stack: List[Any]
    append: Callable[[Any], None]
    read: Callable[[int], bytes]
    pop_mark: Callable[[], List[Any]]

    def find_class(self, module: str, name: str) -> type:
        """A stub instead of what the pickle names."""
        return _stub_class(f"{module}.{name}")

    def persistent_load(self, pid: Any) -> Any:
        """A stub instead of an object kept elsewhere."""
        return _stub_class("persistent")(pid)

    def _set(self) -> None:
        self.append(_stub_class("builtins.set")([]))

    def _frozenset(self) -> None:
        items = self.pop_mark()  # changes `append`
        self.append(_stub_class("builtins.frozenset")(items))

    def _add(self) -> None:
        items = self.pop_mark()
        self.stack[-1].arguments[0].extend(items)

    def _dict(self) -> None:
        items = self.pop_mark()
        self.append({})
        self._fill(items)

    def _setitem(self) -> None:
        value, key = self.stack.pop(), self.stack.pop()
        self._fill([key, value])

    def _setitems(self) -> None:
        self._fill(self.pop_mark())

    def _fill(self, items: List[Any]) -> None:
        target = self.stack[-1]
        if isinstance(target, _Stub):
            target.state = target.state if isinstance(target.state, dict) else {}
            target = target.state
        for key, value in zip(items[::2], items[1::2]):
            plain = isinstance(key, (str, int, float, bytes, bool, type(None)))
            target[key if plain else _show(key, 80)] = value

    def _bytearray(self) -> None:
        # Read as bytes: the original allocates what the pickle announces before it looks for it.
        self.append(self.read(int.from_bytes(self.read(8), "little")))

    def _extension(self) -> None:
        raise UserDataTextError("it names a part of a process that is not this one")

    dispatch.update(
        {
            pickle.EMPTY_SET[0]: _set,
            pickle.FROZENSET[0]: _frozenset,
            pickle.ADDITEMS[0]: _add,
            pickle.DICT[0]: _dict,
            pickle.SETITEM[0]: _setitem,
            pickle.SETITEMS[0]: _setitems,
            pickle.BYTEARRAY8[0]: _bytearray,
            **dict.fromkeys((pickle.EXT1[0], pickle.EXT2[0], pickle.EXT4[0]), _extension),
        }
    )


def _plain(stub: _Stub) -> Any:
    """What older protocols call a function for: bytes and text as themselves, all else as it is."""
    name, arguments = stub.name.replace("__builtin__.", "builtins."), stub.arguments
    if name == "_codecs.encode" and arguments and isinstance(arguments[0], str):
        return arguments[0].encode("latin-1", "replace")
    if name in ("builtins.bytes", "builtins.str") and len(arguments) < 2:
        return arguments[0] if arguments else b""
    if name in ("copy_reg._reconstructor", "copyreg._reconstructor") and arguments:
        made = _stub_class(getattr(arguments[0], "name", "?"))()
        made.state = stub.state
        return made
    return stub


def _show(value: Any, limit: int) -> str:
    """A value as text of bounded length. Shared parts may nest without end, so the length is the budget."""
    parts: List[str] = []
    left = [limit]

    def say(text: str) -> None:
        parts.append(text[: max(0, left[0])])
        left[0] -= len(text)

    def join(items: Any, brackets: str, depth: int, pairs: bool = False) -> None:
        say(brackets[0])
        for number, item in enumerate(items):
            if left[0] <= 0:
                break
            say(", " if number else "")
            walk(item[0] if pairs else item, depth + 1)
            if pairs:
                say(": ")
                walk(item[1], depth + 1)
        say(brackets[1])

    def stub(item: _Stub, depth: int) -> None:
        name = item.name.replace("__builtin__.", "builtins.")
        if name in _SETS:
            say(name.split(".")[1])
            items = item.arguments[0] if item.arguments else []
            join(items if isinstance(items, list) else [items], "{}", depth)
            return
        say(_short_name(name))
        if item.state is not None:
            walk(item.state, depth + 1)
        else:
            join(item.arguments, "()", depth)

    def walk(item: Any, depth: int) -> None:
        item = _plain(item) if isinstance(item, _Stub) else item
        if left[0] <= 0 or depth > 20:
            say("…")
        elif isinstance(item, dict):
            join(item.items(), "{}", depth, pairs=True)
        elif isinstance(item, (list, tuple)):
            join(item, "[]" if isinstance(item, list) else "()", depth)
        elif isinstance(item, _Stub):
            stub(item, depth)
        elif isinstance(item, type):
            say(_short_name(getattr(item, "name", "?")))
        elif isinstance(item, int) and not isinstance(item, bool) and item.bit_length() > 200:
            say(f"<integer of {item.bit_length()} bits>")
        elif isinstance(item, (str, bytes, bytearray)):
            say(repr(item[: max(1, left[0])]))
        else:
            say(repr(item))

    walk(value, 0)
    return "".join(parts) + ("…" if left[0] < 0 else "")


def _short_name(name: str) -> str:
    """``geometry_msgs.msg._Pose.Pose`` → ``geometry_msgs/Pose``."""
    parts = name.split(".")
    return f"{parts[0]}/{parts[-1]}" if len(parts) > 2 and parts[1] == "msg" else name

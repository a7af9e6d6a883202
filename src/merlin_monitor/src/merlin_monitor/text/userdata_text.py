"""Userdata of a state machine as text, read from its pickle without making a single object of it.

A pickle is a program: unpickling runs what it names. This reader follows the opcodes itself and
keeps a note where the program would import or call something, so nothing is executed and nothing imported.
"""

import base64
import binascii
import pickletools
from typing import Any, Callable, Dict, List, Tuple

LONGEST = 256 * 1024  # bytes of pickle that are read
LONGEST_VALUE = 600  # characters shown of one value
_MARK = object()
_Handler = Callable[[Any, str], None]  # of an opcode: its argument and its name


class UserDataTextError(ValueError):
    """Userdata that cannot be shown, with the reason."""


class _Note:
    """An object that would have been made: by name, from arguments, with a state."""

    def __init__(self, name: str, arguments: Any = ()) -> None:
        self.name = name
        self.arguments = arguments
        self.state: Any = None


def userdata_rows(text: str) -> List[Tuple[str, str]]:
    """Key and value, as texts, of ``local_data``.

    :raises UserDataTextError: it is no pickle of a dict.
    """
    if not text:
        return []
    data = _bytes(text)
    if len(data) > LONGEST:
        raise UserDataTextError(f"userdata of {len(data)} bytes is too long to be shown")
    try:
        values = _Reader().read(data)
    except UserDataTextError:
        raise
    except Exception as error:  # hostile bytes find every way to fail
        raise UserDataTextError(f"userdata is no pickle: {type(error).__name__}: {error}") from error
    if not isinstance(values, dict):
        raise UserDataTextError("userdata is no dict")
    return sorted((_show(key, 80).strip("'"), _show(value, LONGEST_VALUE)) for key, value in values.items())


def _bytes(text: str) -> bytes:
    try:
        return base64.b64decode(text.encode("ascii"), validate=True)
    except (UnicodeEncodeError, binascii.Error):
        return text.encode("latin-1", "replace")  # before SMACH 2.5 the pickle itself


class _Reader:
    """The stack machine of pickle, over plain values and notes."""

    def __init__(self) -> None:
        self._stack: List[Any] = []
        self._memo: Dict[int, Any] = {}

    def read(self, data: bytes) -> Any:
        for opcode, argument, _ in pickletools.genops(data):
            if opcode.name == "STOP":
                return self._stack.pop()
            handler: _Handler = getattr(self, f"_do_{opcode.name.lower()}", self._constant)
            handler(argument, opcode.name)
        raise UserDataTextError("userdata ends too early")

    def _constant(self, argument: Any, name: str) -> None:
        if argument is None or name not in _CONSTANTS:
            raise UserDataTextError(f"userdata has the opcode {name}, which is not read")
        self._stack.append(argument)

    def _since_mark(self) -> List[Any]:
        for index in range(len(self._stack) - 1, -1, -1):
            if self._stack[index] is _MARK:
                items = self._stack[index + 1 :]
                del self._stack[index:]
                return items
        raise UserDataTextError("userdata has no mark where one is needed")

    def _do_proto(self, argument: Any, name: str) -> None:
        pass

    _do_frame = _do_proto

    def _do_mark(self, argument: Any, name: str) -> None:
        self._stack.append(_MARK)

    def _do_none(self, argument: Any, name: str) -> None:
        self._stack.append({"NEWTRUE": True, "NEWFALSE": False}.get(name))

    _do_newtrue = _do_newfalse = _do_none

    def _do_empty_dict(self, argument: Any, name: str) -> None:
        self._stack.append({})

    def _do_empty_list(self, argument: Any, name: str) -> None:
        self._stack.append([])

    def _do_empty_tuple(self, argument: Any, name: str) -> None:
        self._stack.append(())

    def _do_empty_set(self, argument: Any, name: str) -> None:
        self._stack.append(_Note("set", []))

    def _do_list(self, argument: Any, name: str) -> None:
        self._stack.append(self._since_mark())

    def _do_tuple(self, argument: Any, name: str) -> None:
        self._stack.append(tuple(self._since_mark()))

    def _do_frozenset(self, argument: Any, name: str) -> None:
        self._stack.append(_Note("frozenset", self._since_mark()))

    def _do_dict(self, argument: Any, name: str) -> None:
        items = self._since_mark()
        self._stack.append({})
        self._fill(items)

    def _do_tuple1(self, argument: Any, name: str) -> None:
        size = int(name[-1])
        if len(self._stack) < size:
            raise UserDataTextError("userdata takes from an empty stack")
        items = tuple(self._stack[-size:])
        del self._stack[-size:]
        self._stack.append(items)

    _do_tuple2 = _do_tuple3 = _do_tuple1

    def _do_append(self, argument: Any, name: str) -> None:
        self._extend([self._stack.pop()])

    def _do_appends(self, argument: Any, name: str) -> None:
        self._extend(self._since_mark())

    _do_additems = _do_appends

    def _extend(self, items: List[Any]) -> None:
        target = self._stack[-1]
        if isinstance(target, _Note) and isinstance(target.arguments, list):
            target = target.arguments
        if isinstance(target, list):
            target.extend(items)

    def _do_setitem(self, argument: Any, name: str) -> None:
        value, key = self._stack.pop(), self._stack.pop()
        self._fill([key, value])

    def _do_setitems(self, argument: Any, name: str) -> None:
        self._fill(self._since_mark())

    def _fill(self, items: List[Any]) -> None:
        target = self._stack[-1]
        for key, value in zip(items[::2], items[1::2]):
            if isinstance(target, dict):
                hashable = isinstance(key, (str, int, float, bytes, bool, type(None)))
                target[key if hashable else _show(key, 80)] = value

    def _do_pop(self, argument: Any, name: str) -> None:
        self._stack.pop()

    def _do_pop_mark(self, argument: Any, name: str) -> None:
        self._since_mark()

    def _do_dup(self, argument: Any, name: str) -> None:
        self._stack.append(self._stack[-1])

    def _do_put(self, argument: Any, name: str) -> None:
        self._memo[len(self._memo) if name == "MEMOIZE" else int(argument)] = self._stack[-1]

    _do_binput = _do_long_binput = _do_memoize = _do_put

    def _do_get(self, argument: Any, name: str) -> None:
        self._stack.append(self._memo[int(argument)])

    _do_binget = _do_long_binget = _do_get

    def _do_global(self, argument: Any, name: str) -> None:
        self._stack.append(_Note(str(argument).replace(" ", ".")))

    def _do_stack_global(self, argument: Any, name: str) -> None:
        attribute, module = self._stack.pop(), self._stack.pop()
        self._stack.append(_Note(f"{module}.{attribute}"))

    def _do_inst(self, argument: Any, name: str) -> None:
        self._stack.append(_Note(str(argument).replace(" ", "."), self._since_mark()))

    def _do_obj(self, argument: Any, name: str) -> None:
        kind, *arguments = self._since_mark() or [None]
        self._stack.append(_made(kind, arguments))

    def _do_reduce(self, argument: Any, name: str) -> None:
        arguments, kind = self._stack.pop(), self._stack.pop()
        self._stack.append(_made(kind, arguments))

    _do_newobj = _do_reduce

    def _do_newobj_ex(self, argument: Any, name: str) -> None:
        self._stack.pop()
        self._do_reduce(argument, name)

    def _do_build(self, argument: Any, name: str) -> None:
        state = self._stack.pop()
        if isinstance(self._stack[-1], _Note):
            self._stack[-1].state = state

    def _do_persid(self, argument: Any, name: str) -> None:
        self._stack.append(_Note("persistent", [argument]))

    def _do_binpersid(self, argument: Any, name: str) -> None:
        self._stack.append(_Note("persistent", [self._stack.pop()]))


_CONSTANTS = frozenset(
    (
        *("INT", "BININT", "BININT1", "BININT2", "LONG", "LONG1", "LONG4", "FLOAT", "BINFLOAT"),
        *("STRING", "BINSTRING", "SHORT_BINSTRING"),
        *("UNICODE", "BINUNICODE", "SHORT_BINUNICODE", "BINUNICODE8"),
        *("BINBYTES", "SHORT_BINBYTES", "BINBYTES8", "BYTEARRAY8"),
    )
)
_PLAIN_MAKERS = ("builtins.set", "__builtin__.set", "builtins.frozenset", "__builtin__.frozenset")


def _made(kind: Any, arguments: Any) -> Any:
    """What a call would give; known makers of plain values give the value."""
    name = kind.name if isinstance(kind, _Note) else "?"
    arguments = list(arguments) if isinstance(arguments, (tuple, list)) else [arguments]
    if name == "_codecs.encode" and arguments and isinstance(arguments[0], str):
        return arguments[0].encode("latin-1", "replace")
    if name in ("builtins.bytes", "__builtin__.bytes") and not arguments:
        return b""
    if name in ("builtins.str", "__builtin__.str") and len(arguments) == 1 and isinstance(arguments[0], str):
        return arguments[0]
    if name in _PLAIN_MAKERS and arguments and isinstance(arguments[0], list):
        return _Note(name.rsplit(".", 1)[1], arguments[0])
    if name in ("copy_reg._reconstructor", "copyreg._reconstructor") and arguments:
        return _Note(arguments[0].name if isinstance(arguments[0], _Note) else "?")
    return _Note(name, arguments)


def _show(value: Any, limit: int) -> str:
    """A value as text of bounded length. Shared parts may nest without end, so the length is the budget."""
    parts: List[str] = []
    left = [limit]

    def say(text: str) -> None:
        parts.append(text[: max(0, left[0])])
        left[0] -= len(text)

    def join(items: Any, opening: str, closing: str, depth: int) -> None:
        say(opening)
        for number, item in enumerate(items):
            if left[0] <= 0:
                break
            if number:
                say(", ")
            walk(item, depth + 1)
        say(closing)

    def walk(item: Any, depth: int) -> None:
        if left[0] <= 0 or depth > 20:
            say("…")
        elif isinstance(item, dict):
            say("{")
            for number, (key, inner) in enumerate(item.items()):
                if left[0] <= 0:
                    break
                say(", " if number else "")
                walk(key, depth + 1)
                say(": ")
                walk(inner, depth + 1)
            say("}")
        elif isinstance(item, list):
            join(item, "[", "]", depth)
        elif isinstance(item, tuple):
            join(item, "(", ")", depth)
        elif isinstance(item, _Note):
            say(_short_name(item.name))
            if item.name in ("set", "frozenset"):
                join(item.arguments, "{", "}", depth)
            elif item.state is not None:
                walk(item.state, depth + 1)
            else:
                join(item.arguments, "(", ")", depth)
        elif item is _MARK:
            say("?")
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

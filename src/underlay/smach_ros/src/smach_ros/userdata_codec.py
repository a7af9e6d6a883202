# SPDX-License-Identifier: Apache-2.0
"""Userdata in introspection messages: a protocol-2 pickle of the dict, base64, as smach_viewer expects it.

Reading builds plain values and ROS messages only. A pickle may name any function and have it called; any
node that can publish could run code, so every other name is refused.
"""

import base64
import binascii
import codecs
import importlib
import io
import pickle
import re
from typing import Any, Callable, Dict

import genpy

from smach.labels import text_of
from smach.read_only import unwrap

PROTOCOL = 2
LONGEST_TEXT = 2000  # characters of a repr
LONGEST = 16 * 1024 * 1024  # bytes of pickle that are read
_MESSAGE_MODULE = re.compile(r"[A-Za-z][A-Za-z0-9_]*\.msg(\._[A-Za-z][A-Za-z0-9_]*)?")


class UserDataError(ValueError):
    """Userdata that cannot be read, with the reason."""


def encode(values: Dict[str, Any]) -> str:
    """The text for ``local_data``.

    A value that cannot be pickled, or whose class a viewer need not have, appears as its ``repr``.
    """
    buffer = io.BytesIO()
    _PlainPickler(buffer, PROTOCOL).dump({text_of(key): value for key, value in values.items()})
    return base64.b64encode(buffer.getvalue()).decode("ascii")


def decode(text: str) -> Dict[str, Any]:
    """The values in ``local_data``, of which no code is run.

    :raises UserDataError: when it is not such a text, or holds other things than plain values and messages.
    """
    if not text:
        return {}
    try:
        data = base64.b64decode(text.encode("ascii"), validate=True)
    except (UnicodeEncodeError, binascii.Error) as error:
        raise UserDataError(f"local_data is not base64: {error}") from error
    if len(data) > LONGEST:
        raise UserDataError(f"local_data is longer than {LONGEST} bytes")
    try:
        values = _PlainUnpickler(io.BytesIO(data)).load()
    except UserDataError:
        raise
    except Exception as error:
        raise UserDataError(f"local_data is not a pickle: {type(error).__name__}: {error}") from error
    if not isinstance(values, dict) or not all(isinstance(key, str) for key in values):
        raise UserDataError(f"local_data holds no dict of texts but a {type(values).__name__}")
    return values


class _PlainPickler(pickle.Pickler):
    """Pickles plain values and ROS messages, and texts in place of anything else."""

    def reducer_override(self, obj: Any) -> Any:
        """Called for all that is not of a built-in type."""
        obj = unwrap(obj)
        kind = obj if isinstance(obj, type) else type(obj)
        if issubclass(kind, (genpy.Message, genpy.TVal)) or kind in (set, frozenset, complex, bytearray):
            return NotImplemented
        if (
            obj is codecs.encode or obj is bytes or obj is str
        ):  # how protocol 2 writes bytes, and this the rest
            return NotImplemented
        return str, (_text(obj),)


def _text(value: Any) -> str:
    try:
        text = repr(value)
    except Exception as error:
        text = f"<{type(value).__name__}; its repr raised {type(error).__name__}>"
    return text if len(text) <= LONGEST_TEXT else text[:LONGEST_TEXT] + "…"


def _allowed(module: str, name: str) -> Callable[..., Any]:
    """What a pickle may name.

    :raises UserDataError: anything else.
    """
    module = {"__builtin__": "builtins", "copy_reg": "copyreg"}.get(module, module)
    found = _PLAIN.get((module, name))
    if found is not None:
        return found
    if _MESSAGE_MODULE.fullmatch(module):
        try:
            found = getattr(importlib.import_module(module), name)
        except (ImportError, AttributeError):
            found = None
        if isinstance(found, type) and issubclass(found, genpy.Message):
            return found
    raise UserDataError(
        f"local_data holds a '{module}.{name}'; only plain values and ROS messages are accepted"
    )


def _encode_latin(text: str, encoding: str) -> bytes:
    """How protocol 2 writes bytes; no other codec, for some expand without limit."""
    if encoding not in ("latin1", "latin-1"):
        raise UserDataError(f"local_data asks for the codec {encoding!r}")
    return text.encode("latin-1")


def _bytes(*args: Any) -> bytes:
    if args:
        raise UserDataError("local_data makes bytes from something else than text")
    return b""


def _str(*args: Any) -> str:
    if len(args) != 1 or not isinstance(args[0], str):
        raise UserDataError("local_data makes a text from something else than text")
    return args[0]


def _bytearray(*args: Any) -> bytearray:
    if not all(isinstance(arg, (str, bytes)) for arg in args):
        raise UserDataError("local_data makes a bytearray from something else than bytes")
    return bytearray(*args)


def _reconstruct(cls: type, base: type, state: Any) -> Any:
    """How older protocols make a message."""
    if base is not object or not issubclass(cls, (genpy.Message, genpy.TVal)):
        raise UserDataError(f"local_data rebuilds a {cls!r}")
    return object.__new__(cls)


_PLAIN: Dict[Any, Any] = {
    ("builtins", "set"): set,
    ("builtins", "frozenset"): frozenset,
    ("builtins", "complex"): complex,
    ("builtins", "bytes"): _bytes,
    ("builtins", "bytearray"): _bytearray,
    ("builtins", "object"): object,
    ("builtins", "str"): _str,
    ("_codecs", "encode"): _encode_latin,
    ("copyreg", "_reconstructor"): _reconstruct,
    ("genpy.rostime", "Time"): genpy.Time,
    ("genpy.rostime", "Duration"): genpy.Duration,
    ("rospy.rostime", "Time"): genpy.Time,
    ("rospy.rostime", "Duration"): genpy.Duration,
}


class _PlainUnpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        return _allowed(module, name)

    def persistent_load(self, pid: Any) -> Any:
        raise UserDataError("local_data refers to something outside itself")

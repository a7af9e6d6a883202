# SPDX-License-Identifier: Apache-2.0
"""A read-only view of an object: what a state gets for an input key that is not one of its output keys."""

import copy
import enum
import types
import weakref
from typing import Any, Callable, Dict, SupportsIndex

# Through a proxy these lose what they are when they are called, compared or raised; C code wants real texts
# and numbers. They carry no data to protect.
_BARE = (
    *(type, types.FunctionType, types.BuiltinFunctionType, types.MethodType, types.ModuleType),
    *(enum.Enum, str, bytes, int, float, complex, BaseException),
)
_IN_PLACE = "add sub mul matmul truediv floordiv mod pow lshift rshift and xor or concat"
_OF_THE_VIEW = (
    "class new init del getattribute getattr setattr delattr setitem delitem reduce reduce_ex getstate "
    "setstate getnewargs getnewargs_ex init_subclass subclasshook class_getitem set_name get set delete copy "
    "deepcopy sizeof post_init"
)
_NOT_FORWARDED = frozenset(
    [f"__{name}__" for name in _OF_THE_VIEW.split()] + [f"__i{name}__" for name in _IN_PLACE.split()]
)


class ReadOnly:
    """Base of the views; each wrapped type has a subclass with exactly its special methods."""

    __slots__ = ("__weakref__", "_wrapped")

    def __init__(self, wrapped: Any) -> None:
        object.__setattr__(self, "_wrapped", wrapped)

    @property  # type: ignore[misc]
    def __class__(self) -> type:
        # isinstance() asks for this.
        return type(object.__getattribute__(self, "_wrapped"))

    def __getattr__(self, name: str) -> Any:
        return getattr(object.__getattribute__(self, "_wrapped"), name)

    def __setattr__(self, name: str, value: Any) -> None:
        raise TypeError(_refusal(self, f"attribute '{name}'"))

    def __delattr__(self, name: str) -> None:
        raise TypeError(_refusal(self, f"attribute '{name}'"))

    def __setitem__(self, key: Any, value: Any) -> None:
        raise TypeError(_refusal(self, f"item {key!r}"))

    def __delitem__(self, key: Any) -> None:
        raise TypeError(_refusal(self, f"item {key!r}"))

    def __reduce_ex__(self, protocol: SupportsIndex) -> Any:
        return unwrap(self).__reduce_ex__(protocol)

    def __copy__(self) -> Any:
        return copy.copy(unwrap(self))

    def __deepcopy__(self, memo: Dict[int, Any]) -> Any:
        return copy.deepcopy(unwrap(self), memo)


def read_only(value: Any) -> Any:
    """The value as a state may see it that must not change it.

    Values without a ``__dict__`` (numbers, text, lists, ROS messages) are returned as they are, as in SMACH;
    others as a view on which writing raises TypeError, and which otherwise behaves as the value does.
    """
    if not hasattr(value, "__dict__") or isinstance(value, _BARE) or _is_view(value):
        return value
    return _view_class(type(value))(value)


def unwrap(value: Any) -> Any:
    """The object behind a view; any other value itself."""
    return object.__getattribute__(value, "_wrapped") if _is_view(value) else value


def _is_view(value: Any) -> bool:
    return issubclass(type(value), ReadOnly)


def _refusal(view: ReadOnly, what: str) -> str:
    return (
        f"{what} of a {type(unwrap(view)).__name__} is read-only here: the userdata key is an "
        "input key of this state; declare it in io_keys to change it"
    )


_view_classes = weakref.WeakKeyDictionary()  # type: ignore[var-annotated]


def _view_class(wrapped: type) -> type:
    try:
        return _view_classes[wrapped]
    except KeyError:
        pass
    members: Dict[str, Any] = {"__slots__": (), "__module__": __name__}
    # A metaclass may leave some out of dir().
    for name in {name for kind in wrapped.__mro__ for name in vars(kind)}:
        if name.startswith("__") and name.endswith("__") and name not in _NOT_FORWARDED:
            member = getattr(wrapped, name)
            if callable(member):
                members[name] = _forward(name)
            elif name == "__hash__":
                members[name] = None
    made = type(f"ReadOnly{wrapped.__name__}", (ReadOnly,), members)
    _view_classes[wrapped] = made
    return made


def _forward(name: str) -> Callable[..., Any]:
    def forward(self: ReadOnly, *args: Any, **fields: Any) -> Any:
        wrapped = unwrap(self)
        # Special methods are looked up on the type, as the interpreter does.
        return getattr(type(wrapped), name)(wrapped, *map(unwrap, args), **fields)

    forward.__name__ = name
    return forward

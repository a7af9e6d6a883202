# SPDX-License-Identifier: Apache-2.0
"""Callbacks that declare their outcomes and userdata keys."""

import functools
from typing import Any, Callable, Iterable, Optional, Tuple

from smach.ordered_set import OrderedSet


def has_smach_interface(obj: Any) -> bool:
    """Whether an object declares input keys, output keys and outcomes."""
    return all(
        hasattr(obj, name)
        for name in (
            "get_registered_input_keys",
            "get_registered_output_keys",
            "get_registered_outcomes",
        )
    )


class CBInterface:
    """A callable with a declared interface.

    :param cb: called in its place.
    :param outcomes: that it may return.
    :param input_keys: userdata keys that it reads.
    :param output_keys: userdata keys that it writes.
    :param io_keys: userdata keys that it reads and writes.
    """

    def __init__(
        self,
        cb: Callable[..., Any],
        outcomes: Optional[Iterable[str]] = None,
        input_keys: Optional[Iterable[str]] = None,
        output_keys: Optional[Iterable[str]] = None,
        io_keys: Optional[Iterable[str]] = None,
    ) -> None:
        if not callable(cb):
            raise TypeError(f"CBInterface needs something callable, not {cb!r}")
        io_keys = list(io_keys or ())
        self._cb = cb
        self._outcomes = OrderedSet(outcomes or ())
        self._input_keys = OrderedSet([*(input_keys or ()), *io_keys])
        self._output_keys = OrderedSet([*(output_keys or ()), *io_keys])
        functools.update_wrapper(self, cb, updated=())

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """Calls the callable."""
        return self._cb(*args, **kwargs)

    def get_registered_input_keys(self) -> Tuple[str, ...]:
        """Userdata keys that it reads."""
        return tuple(self._input_keys)

    def get_registered_output_keys(self) -> Tuple[str, ...]:
        """Userdata keys that it writes."""
        return tuple(self._output_keys)

    def get_registered_outcomes(self) -> Tuple[str, ...]:
        """Outcomes that it may return."""
        return tuple(self._outcomes)


def cb_interface(
    outcomes: Optional[Iterable[str]] = None,
    input_keys: Optional[Iterable[str]] = None,
    output_keys: Optional[Iterable[str]] = None,
    io_keys: Optional[Iterable[str]] = None,
) -> Callable[[Callable[..., Any]], CBInterface]:
    """Decorator that declares the interface of a callback; parameters as of :class:`CBInterface`."""
    return lambda cb: CBInterface(cb, outcomes, input_keys, output_keys, io_keys)

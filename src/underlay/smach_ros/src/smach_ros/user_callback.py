# SPDX-License-Identifier: Apache-2.0
"""A user's callback, and filling messages from userdata."""

import copy
from typing import Any, Callable, Iterable, List, Mapping, Optional, Type

import smach
from smach.read_only import unwrap


class UserCallback:
    """A callback with fixed arguments and the userdata keys it may use.

    :param cb: None: nothing is called.
    :param args: that follow what the state passes.
    :param kwargs: likewise.
    :param state: takes over the interface that the callback declares (:func:`smach.cb_interface`).
    :param input_keys: that it may read if it declares nothing.
    :param output_keys: that it may write if it declares nothing.
    """

    def __init__(
        self,
        cb: Optional[Callable[..., Any]],
        args: Iterable[Any],
        kwargs: Optional[Mapping[str, Any]],
        state: smach.State,
        input_keys: List[str],
        output_keys: List[str],
        name: str,
    ) -> None:
        if cb is not None and not callable(cb):
            raise smach.InvalidStateError(f"{name} must be callable, not {cb!r}")
        self._cb = cb
        self._args = list(args)
        self._kwargs = dict(kwargs or {})
        self._input_keys, self._output_keys = list(input_keys), list(output_keys)
        if smach.has_smach_interface(cb):
            self._input_keys = list(cb.get_registered_input_keys())  # type: ignore[union-attr]
            self._output_keys = list(cb.get_registered_output_keys())  # type: ignore[union-attr]
            state.register_input_keys(self._input_keys)
            state.register_output_keys(self._output_keys)
            state.register_outcomes(cb.get_registered_outcomes())  # type: ignore[union-attr]

    def __call__(self, ud: Any, *first: Any) -> Any:
        """Calls the callback with its view of the userdata."""
        if self._cb is None:
            return None
        view = smach.Remapper(ud, self._input_keys, self._output_keys)
        return self._cb(view, *first, *self._args, **self._kwargs)


def check_slots(message_type: Type[Any], slots: Iterable[str], what: str) -> List[str]:
    """Checks that a message type has the fields.

    :raises smach.InvalidConstructionError: it has not; names those it has.
    """
    slots = list(slots)
    unknown = [slot for slot in slots if slot not in message_type.__slots__]
    if unknown:
        raise smach.InvalidConstructionError(
            f"{what}: {message_type._type} has no field {unknown}; its fields: {list(message_type.__slots__)}"
        )
    return slots


def fill(
    message_type: Type[Any],
    template: Any,
    key: Optional[str],
    slots: Iterable[str],
    cb: UserCallback,
    ud: Any,
) -> Any:
    """Makes a message: from the template, the userdata key, single keys and the callback, in this order.

    Nothing that outlives the call is shared with it, so editing it in place changes it alone.

    :raises Exception: what the callback raised, or a key that has no value.
    :raises TypeError: when the result is not a message of the type.
    """
    message = copy.deepcopy(template) if template is not None else message_type()
    if key is not None:
        message = copy.deepcopy(unwrap(ud[key]))
    for slot in slots:
        setattr(message, slot, copy.deepcopy(unwrap(ud[slot])))
    answer = cb(ud, message)
    if answer is not None:
        message = answer
    if not isinstance(message, message_type):
        raise TypeError(f"needed is a {message_type._type}, not {message!r}")
    return unwrap(message)

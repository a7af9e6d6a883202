# SPDX-License-Identifier: Apache-2.0
"""The base of all states."""

from typing import Any, Callable, Iterable, List, Mapping, Optional, Tuple

from smach.cb_interface import has_smach_interface
from smach.execution.run_context import flag_lock, next_number
from smach.labels import is_name
from smach.ordered_set import OrderedSet

__all__ = ["CBState", "State"]


class State:
    """Something that is executed and ends with one of its declared outcomes.

    :param outcomes: that :meth:`execute` may return.
    :param input_keys: userdata keys that it reads.
    :param output_keys: userdata keys that it writes.
    :param io_keys: userdata keys that it reads and writes.
    """

    # Class attributes as well, for subclasses that touch them before they call __init__.
    _preempt_requested: bool = False
    _preempt_number: int = 0  # when the last preempt request was made, see run_context
    _prepared_at: int = 0  # when the coming run was prepared; 0: it was not

    def __init__(
        self,
        outcomes: Optional[Iterable[str]] = None,
        input_keys: Optional[Iterable[str]] = None,
        output_keys: Optional[Iterable[str]] = None,
        io_keys: Optional[Iterable[str]] = None,
    ) -> None:
        io = names(io_keys, "io_keys")
        self._outcomes = OrderedSet(names(outcomes, "outcomes"))
        self._input_keys = OrderedSet(names(input_keys, "input_keys") + io)
        self._output_keys = OrderedSet(names(output_keys, "output_keys") + io)
        self._preempt_requested = False

    def execute(self, ud: Any) -> str:
        """Does what the state is for; to be overridden.

        :param ud: userdata, limited to the declared keys.
        :return: one of the registered outcomes.
        """
        raise NotImplementedError(f"{type(self).__name__} does not override execute()")

    def register_outcomes(self, new_outcomes: Iterable[str]) -> None:
        """Adds outcomes."""
        self._outcomes.update(names(new_outcomes, "outcomes"))

    def get_registered_outcomes(self) -> Tuple[str, ...]:
        """The outcomes, in the order they were registered."""
        return _tuple(self._outcomes)

    def register_io_keys(self, keys: Iterable[str]) -> None:
        """Adds keys that are read and written."""
        keys = names(keys, "io_keys")
        self._input_keys.update(keys)
        self._output_keys.update(keys)

    def register_input_keys(self, keys: Iterable[str]) -> None:
        """Adds keys that are read."""
        self._input_keys.update(names(keys, "input_keys"))

    def get_registered_input_keys(self) -> Tuple[str, ...]:
        """The keys that are read."""
        return _tuple(self._input_keys)

    def register_output_keys(self, keys: Iterable[str]) -> None:
        """Adds keys that are written."""
        self._output_keys.update(names(keys, "output_keys"))

    def get_registered_output_keys(self) -> Tuple[str, ...]:
        """The keys that are written."""
        return _tuple(self._output_keys)

    def prepare_run(self) -> None:
        """Begins the next run before it is executed: requests up to now are forgotten, later ones count.

        For a caller that starts the execution in another thread and may preempt it before that has come to
        ``execute()``. SMACH has no such method.
        """
        with flag_lock:
            self._prepared_at = next_number()
            self._preempt_requested = False

    def request_preempt(self) -> None:
        """Asks the state to end soon. May be overridden to wake it; call this too."""
        with flag_lock:
            self._preempt_number = next_number()
            self._preempt_requested = True

    def service_preempt(self) -> None:
        """Says that the state has acted on the request."""
        self._preempt_requested = False

    def recall_preempt(self) -> None:
        """Takes the request back."""
        self._preempt_requested = False

    def preempt_requested(self) -> bool:
        """Whether the state should end."""
        return self._preempt_requested


class CBState(State):
    """Executes ``cb(ud, *cb_args, **cb_kwargs)`` and ends with what it returns.

    :param cb: if it declares an interface (:func:`smach.cb_interface`), that becomes the state's.
    :param outcomes: that it may return.
    :param input_keys: userdata keys that it reads.
    :param output_keys: userdata keys that it writes.
    :param io_keys: userdata keys that it reads and writes.
    """

    def __init__(
        self,
        cb: Callable[..., str],
        cb_args: Iterable[Any] = (),
        cb_kwargs: Optional[Mapping[str, Any]] = None,
        outcomes: Optional[Iterable[str]] = None,
        input_keys: Optional[Iterable[str]] = None,
        output_keys: Optional[Iterable[str]] = None,
        io_keys: Optional[Iterable[str]] = None,
    ) -> None:
        super().__init__(outcomes, input_keys, output_keys, io_keys)
        if not callable(cb):
            raise TypeError(f"CBState needs something callable, not {cb!r}")
        self._cb = cb
        self._cb_args = list(cb_args)
        self._cb_kwargs = dict(cb_kwargs or {})
        if has_smach_interface(cb):
            interface: Any = cb
            self.register_outcomes(interface.get_registered_outcomes())
            self.register_input_keys(interface.get_registered_input_keys())
            self.register_output_keys(interface.get_registered_output_keys())

    def execute(self, ud: Any) -> str:
        """Calls the function."""
        return self._cb(ud, *self._cb_args, **self._cb_kwargs)


def names(values: Optional[Iterable[str]], what: str) -> List[str]:
    """Checks a list of outcomes or keys.

    :param what: the argument's name, for the error.
    :raises TypeError: when it is a single string instead of a list, or an item cannot be a name.
    """
    if values is None:
        return []
    if isinstance(values, (str, bytes)):
        raise TypeError(f"{what} must be a list of strings, not the string {values!r}; write [{values!r}]")
    values = list(values)
    for value in values:
        if not is_name(value):
            raise TypeError(f"{what} must be texts, members of an enumeration or numbers, not {value!r}")
    return values


def _tuple(values: Iterable[str]) -> Tuple[str, ...]:
    # Programs are known to put plain sets in the place of ours.
    return values.as_tuple() if isinstance(values, OrderedSet) else tuple(values)

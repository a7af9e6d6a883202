"""A state made of a function."""

from typing import Any, Callable, Iterable, Mapping, Optional

from smach.cb_interface import has_smach_interface
from smach.state import State


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
        self._args = list(cb_args)
        self._kwargs = dict(cb_kwargs or {})
        if has_smach_interface(cb):
            self.register_outcomes(cb.get_registered_outcomes())
            self.register_input_keys(cb.get_registered_input_keys())
            self.register_output_keys(cb.get_registered_output_keys())

    def execute(self, ud: Any) -> str:
        """Calls the function."""
        return self._cb(ud, *self._args, **self._kwargs)

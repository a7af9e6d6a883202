# SPDX-License-Identifier: Apache-2.0
"""A state that is a function: what a machine decides or remembers between two states that act."""

from typing import Any, Callable, Optional, Sequence

from merlin_sm.states.merlin_state import MerlinState
from merlin_sm.states.text_keys import check_keys


class FunctionState(MerlinState):
    """Calls a function with the userdata. It has to return soon; what waits is a state of its own.

    :param function: returns an outcome, or None for succeeded, and nothing else; raise ValueError to abort
        with its text, GivenUp when another try cannot help. A knowledge base that refuses or does not answer
        aborts likewise.
    :param inputs: userdata keys that it reads.
    :param outputs: userdata keys that it sets.
    :param outcomes: that it may return besides succeeded.
    :raises ValueError: when the function reads a key that is not listed, or has other parameters.
    """

    def __init__(
        self,
        function: Callable[[Any], Optional[str]],
        inputs: Sequence[str] = (),
        outputs: Sequence[str] = (),
        outcomes: Sequence[str] = (),
    ) -> None:
        if not callable(function):
            raise ValueError(f"{function!r} is not a function")
        check_keys(function, inputs, outputs, "inputs")
        super().__init__(outcomes, inputs, outputs)
        self._function = function

    def run(self, userdata: Any) -> str:
        """Calls the function; its result is the outcome."""
        return self.choose(self._function, userdata)

# SPDX-License-Identifier: Apache-2.0
"""A state whose function reads userdata that it does not list is refused when it is made."""

from typing import Any, Callable

import pytest

from merlin_sm.states.function_state import FunctionState
from merlin_sm.states.text_keys import keys_read


class Machine:
    def decide(self, userdata: Any) -> str:
        userdata.seen = userdata["heard"]
        return "yes" if userdata.heard else "no"


def forwards(userdata: Any) -> None:
    print(userdata)


def another(userdata: Any) -> Any:
    userdata = Machine()
    return userdata.decide


@pytest.mark.parametrize(
    ("function", "keys"),
    [
        (Machine().decide, ["heard"]),
        (lambda userdata: userdata.a + userdata.b, ["a", "b"]),
        (lambda _: "succeeded", []),
        (forwards, []),
        (another, []),
        (print, []),
        (lambda: None, []),
    ],
)
def test_the_keys_that_a_function_reads(function: Callable[..., Any], keys: list) -> None:
    assert keys_read(function) == keys


def test_a_key_that_is_not_listed_is_named() -> None:
    with pytest.raises(ValueError, match="decide, line 1.*'heard', .* the inputs of its state: x"):
        FunctionState(Machine().decide, ["x"], ["seen"])
    FunctionState(Machine().decide, ["heard"], ["seen"])

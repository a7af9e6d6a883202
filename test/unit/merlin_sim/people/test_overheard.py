# SPDX-License-Identifier: Apache-2.0
"""A sentence is answered once, in whatever order its parts come."""

import itertools
from typing import Any, Callable, Dict, List

import pytest

from merlin_sim.people.overheard import Overheard


def said(overheard: "Overheard[str]", text: str, order: List[str]) -> List[Any]:
    """Lets the parts of a sentence come in an order; returns what is answered, as text and hearer."""
    parts: Dict[str, Callable[[], Any]] = {
        "text": lambda: overheard.request(text),
        "begin": overheard.begin,
        "sound": lambda: overheard.sound("ann"),
        "end": overheard.end,
    }
    asked = [sentence for part in order for sentence in [parts[part]()] if sentence is not None]
    return [(sentence.text, sentence.hearer) for sentence in asked]


ORDERS = [
    order
    for order in map(list, itertools.permutations(["text", "begin", "sound", "end"]))
    if order.index("begin") < order.index("end")
]


@pytest.mark.parametrize("order", ORDERS)
def test_each_order_is_one_question(order: List[str]) -> None:
    overheard: Overheard[str] = Overheard()
    assert said(overheard, "Hello?", ["text", "begin", "sound", "end"]) == [("Hello?", "ann")]
    assert said(overheard, "Tea?", order) == [("Tea?", "ann")]
    assert said(overheard, "Bye.", ["text", "begin", "sound", "sound", "end"]) == [("Bye.", "ann")]


def test_late_sound_is_no_second_question() -> None:
    overheard: Overheard[str] = Overheard()
    assert said(overheard, "Hello?", ["text", "begin", "sound", "end", "sound", "sound"]) == [
        ("Hello?", "ann")
    ]


def test_what_is_not_heard_is_not_answered() -> None:
    overheard: Overheard[str] = Overheard()
    assert said(overheard, "Hello?", ["text", "begin", "end"]) == []
    assert said(overheard, "Tea?", ["text", "begin", "sound", "end"]) == [("Tea?", "ann")]


def test_silence_at_the_beginning_is_no_sentence() -> None:
    overheard: Overheard[str] = Overheard()
    assert overheard.end() is None
    assert said(overheard, "Hello?", ["text", "begin", "sound", "end"]) == [("Hello?", "ann")]

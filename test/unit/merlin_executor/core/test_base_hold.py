# SPDX-License-Identifier: Apache-2.0
"""A base that is held is named with the one that holds it, and since when."""

import time
from datetime import datetime

import pytest

from merlin_executor.core.base_hold import hold_words, holder_of
from merlin_ros.work.passed_time import clock_text

AFTERNOON = datetime(2026, 11, 25, 14, 3, 7).timestamp()  # of this computer's time zone


def test_time_of_a_simulation_and_of_the_day() -> None:
    assert clock_text(0.0) == "0.0 s"
    assert clock_text(86_412.34) == "86412.3 s"
    assert clock_text(AFTERNOON) == "14:03:07" == time.strftime("%H:%M:%S", time.localtime(AFTERNOON))


@pytest.mark.parametrize(
    ("reason", "holder", "words"),
    [
        ("stopped by Ana", "Ana", "held by Ana"),
        ("stopped by Ana stopped by Bob", "Ana stopped by Bob", "held by Ana stopped by Bob"),
        ("stopped on the topic merlin/stop", "", "held on the topic merlin/stop"),
        ("a lease is silent", "", "held a lease is silent"),
    ],
)
def test_holder(reason: str, holder: str, words: str) -> None:
    assert holder_of(reason) == holder
    assert hold_words("", reason, 123.44) == f"the base is {words} since 123.4 s"
    assert hold_words("ann", reason, AFTERNOON) == f"robot ann is {words} since 14:03:07"

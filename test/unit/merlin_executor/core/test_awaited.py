# SPDX-License-Identifier: Apache-2.0
"""A wait for several parts of the robot ends with the last of them, and names those that stay away."""

import threading
from typing import Callable

from merlin_executor.core.awaited import Awaited
from merlin_test import LONG


class Over:
    """A wait that does whatever comes in the meantime, and is over then."""

    def __init__(self, *meanwhile: Callable[[], None]) -> None:
        self.meanwhile = list(meanwhile)

    def wait(self, condition: threading.Condition, predicate: Callable[[], bool]) -> bool:
        for event in self.meanwhile:
            if predicate():
                break
            event()
        return predicate()


def test_those_that_stay_away_are_named_in_the_given_order() -> None:
    awaited = Awaited(["talk", "drive", "see", "drive"])
    assert awaited.wait(Over(lambda: awaited.heard("drive")).wait) == ["talk", "see"]


def test_it_is_over_when_all_are_there() -> None:
    awaited = Awaited(["talk", "drive"])
    late: list = []
    over = Over(
        lambda: awaited.heard("talk"), lambda: awaited.heard("drive"), lambda: late.append("waited on")
    )
    assert awaited.wait(over.wait) == [] and not late


def test_nothing_is_waited_for_without_names() -> None:
    assert Awaited([]).wait(Over(lambda: 1 / 0).wait) == []


def test_others_do_not_count() -> None:
    awaited = Awaited(["drive"])
    awaited.heard("fly")
    awaited.heard("drive")
    awaited.heard("drive")
    assert awaited.wait(Over().wait) == []


class Condition:
    """Waits on the condition itself, as a deadline does."""

    def wait(self, condition: threading.Condition, predicate: Callable[[], bool]) -> bool:
        return condition.wait_for(predicate, LONG)


def test_a_name_from_another_thread_ends_the_wait() -> None:
    awaited = Awaited(["drive"])
    sender = threading.Thread(target=awaited.heard, args=("drive",), daemon=True)
    sender.start()
    assert awaited.wait(Condition().wait) == []
    sender.join(LONG)

# SPDX-License-Identifier: Apache-2.0
"""Taking an order: what the guest says decides where the conversation goes, and it ends."""

from typing import Any, List, Optional

import pytest

from merlin_restaurant.actions import take_order
from merlin_restaurant.actions.take_order import TRIES, TakeOrder
from merlin_sm.states.function_state import FunctionState


class Conversation(TakeOrder):
    """Hears what a test lets the guest say; `facts` are what it remembered and forgot."""

    def __init__(self, orders: List[str], answers: List[str]) -> None:
        self.said = {"Good evening": list(orders), "You would like": list(answers)}
        self.remembered: List[str] = []
        self.forgotten: List[str] = []
        super().__init__()

    def state(self, name: str, *args: Any, **options: Any) -> Any:
        if name != "ask":
            return super().state(name, *args, **options)
        heard = next(said for begin, said in self.said.items() if args[0].startswith(begin))

        def answer(userdata: Any) -> Optional[str]:
            said = userdata.heard = heard.pop(0) if heard else ""
            return None if said else "misunderstood"

        return FunctionState(answer, outputs=["heard"], outcomes=["misunderstood"])

    def remove_facts(self, facts: Any) -> None:
        self.forgotten.append(facts)


@pytest.fixture(autouse=True)
def remember(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        take_order, "remember_order", lambda robot, table, items: robot.remembered.extend(items)
    )


def test_an_order_is_remembered_as_soon_as_the_guest_agrees() -> None:
    taken = Conversation(["a juice please", "a coffee and a cake"], ["no", "yes please"])
    assert taken.run_once({"t": "table_1"}) == "succeeded"
    assert taken.remembered == ["coffee", "cake"]


def test_a_guest_who_always_says_no_is_left_like_one_who_says_nothing() -> None:
    taken = Conversation(["a juice"] * 100, ["no"] * 100)
    for _ in range(2):  # the second time as patiently as the first
        left = len(taken.said["You would like"])
        assert taken.run_once({"t": "table_1"}) == "aborted"
        assert left - len(taken.said["You would like"]) == TRIES
    assert "no answer at table_1 was understood" in taken.reason
    assert taken.forgotten == ["(needs_serving table_1)"] * 2
    assert taken.remembered == []


def test_silence_ends_the_conversation() -> None:
    assert Conversation([], []).run_once({"t": "table_1"}) == "aborted"

# SPDX-License-Identifier: Apache-2.0
"""A guest whom a robot hides for a moment keeps the order; one who has left does not."""

from types import SimpleNamespace
from typing import Any, Callable, List

import pytest

from merlin_restaurant import second_look
from merlin_restaurant.actions.check_table import CheckTable
from merlin_restaurant.actions.deliver_order import DeliverOrder
from merlin_restaurant.second_look import LOOKS, SecondLook
from merlin_sm.states import wait
from merlin_sm.states.function_state import FunctionState
from smach import State, UserData


class Looking(SecondLook):
    """Sees what a test says, the last of it again and again."""

    def __init__(self, looks: List[List[str]], known: List[str]) -> None:
        self.count = 0
        self._seen, self._known = looks, known
        super().__init__()

    def look(self) -> State:
        return FunctionState(self._take, outputs=["detections"])

    def _take(self, userdata: Any) -> None:
        userdata.detections = self._seen[min(self.count, len(self._seen) - 1)]
        self.count += 1

    def holds(self, condition: str) -> bool:
        return condition in self._known


@pytest.fixture(autouse=True)
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    def over(seconds: float, call: Callable[[], None], name: str) -> Any:
        call()
        return SimpleNamespace(cancel=lambda: None, shutdown=lambda: None)

    monkeypatch.setattr(wait, "call_after", over)
    monkeypatch.setattr(second_look, "people_at", lambda table, seen: seen.count("person"))


@pytest.mark.parametrize(
    ("looks", "known", "count"),
    [
        ([["person"]], ["(ordered table_1)"], 1),
        ([[], ["person", "cup"]], ["(ordered table_1)"], 2),
        ([[]], ["(ordered table_1)"], LOOKS),
        ([[]], ["(ordered table_2)"], 1),
    ],
)
def test_it_looks_again_where_an_order_is_under_way(
    looks: List[List[str]], known: List[str], count: int
) -> None:
    looking = Looking(looks, known)
    for _ in range(2):  # the second time as patiently as the first
        looking.count = 0
        userdata = UserData()
        userdata.t = "table_1"
        assert looking.execute(userdata) == "succeeded"
        assert looking.count == count
        assert userdata.detections == looks[-1]


@pytest.mark.parametrize("action", [CheckTable, DeliverOrder])
def test_several_robots_look_at_tables_so(action: Any) -> None:
    assert isinstance(action.fitted(["r", "t"], "r")().get_children()["LOOK"], SecondLook)
    assert not isinstance(action().get_children()["LOOK"], SecondLook)

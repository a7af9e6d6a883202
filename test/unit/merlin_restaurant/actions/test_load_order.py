# SPDX-License-Identifier: Apache-2.0
"""Loading an order: the barman is asked again until nothing of it stays on the bar, but not for ever."""

from typing import Any, List, Optional

import pytest

from merlin_restaurant.actions import load_order
from merlin_restaurant.actions.load_order import TRIES, LoadOrder
from merlin_sm.states.function_state import FunctionState


class Loading(LoadOrder):
    """Hears and sees what a test says; the last answer and the last look stay."""

    def __init__(self, answers: List[str], looks: List[List[str]]) -> None:
        self.asked = 0
        self._answers, self._looks = answers, looks
        super().__init__()

    def state(self, name: str, *args: Any, **options: Any) -> Any:
        if name == "ask":
            return FunctionState(self._answer, outputs=["heard"], outcomes=["misunderstood"])
        if name == "recognize":
            return FunctionState(self._look, outputs=["detections"])
        return super().state(name, *args, **options)

    def _answer(self, userdata: Any) -> Optional[str]:
        self.asked += 1
        heard = userdata.heard = self._answers.pop(0) if len(self._answers) > 1 else self._answers[0]
        return None if heard else "misunderstood"

    def _look(self, userdata: Any) -> None:
        userdata.detections = self._looks.pop(0) if len(self._looks) > 1 else self._looks[0]


@pytest.fixture(autouse=True)
def bar(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(load_order, "spot", lambda point, ahead: (0.0, 0.0))
    monkeypatch.setattr(load_order, "seen_near", lambda detections, place, around: list(detections))


def test_what_is_left_is_asked_for_again() -> None:
    loading = Loading(["here you are"], [["cake"], []])
    assert loading.run_once({"t": "table_1"}) == "succeeded"
    assert loading.asked == 2


def test_a_barman_who_is_not_understood_is_asked_again() -> None:
    loading = Loading(["", "here you are"], [[]])
    assert loading.run_once({"t": "table_1"}) == "succeeded"
    assert loading.asked == 2


def test_it_ends_with_what_is_left() -> None:
    loading = Loading(["here you are"], [["cake", "juice"]])
    for _ in range(2):  # the second time as patiently as the first
        loading.asked = 0
        assert loading.run_once({"t": "table_1"}) == "aborted"
        assert loading.reason == "the barman leaves it on the bar: cake and juice"
        assert loading.asked == TRIES

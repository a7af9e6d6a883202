# SPDX-License-Identifier: Apache-2.0
"""How far a robot is behind what the store tells, and that it then writes nothing that comes too late."""

import importlib.util
from collections import defaultdict
from pathlib import Path
from typing import Any, Dict, List

import pytest

from merlin_fleet.core import events as ev
from merlin_fleet.core import records
from merlin_fleet.core.lag import LONGEST, PATIENCE, TOLERATED, Lag
from merlin_fleet.core.records import Goal
from merlin_fleet.core.store import Put, Txn
from merlin_fleet.core.view import FleetView

_SPEC = importlib.util.spec_from_file_location("fleet_crowd", Path(__file__).parents[1] / "fleet_crowd.py")
crowds = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(crowds)
KEYS, joined = crowds.KEYS, crowds.joined


def test_the_lag_is_from_an_answer_to_its_change() -> None:
    lag = Lag()
    lag.wrote(7, seen=5, now=10.0)
    assert lag.blind(10.0)
    lag.saw(6, 11.0)
    assert lag.blind(11.0)
    assert lag.seconds(11.0) == 1.0, "it is at least what it has waited for"
    lag.saw(9, 13.0)
    assert not lag.blind(13.0)
    assert lag.seconds(13.0) == 3.0
    assert lag.until == 13.0 + PATIENCE * (3.0 - TOLERATED)
    assert lag.seconds(lag.until) == 0.0


def test_a_change_that_overtakes_its_answer_is_no_lag() -> None:
    lag = Lag()
    lag.saw(7, 10.0)
    lag.wrote(7, seen=7, now=10.5)
    assert not lag.blind(10.5)
    assert lag.seconds(10.5) == 0.0
    assert lag.until <= 10.5


def test_a_small_lag_has_no_consequence() -> None:
    lag = Lag()
    lag.wrote(7, seen=5, now=10.0)
    lag.saw(7, 10.0 + TOLERATED / 2)
    assert lag.until <= 10.0 + TOLERATED / 2
    assert lag.seconds(10.0 + TOLERATED) == 0.0


@pytest.mark.parametrize("forgets", [False, True])
def test_what_a_replaced_store_has_said_is_not_awaited_for_ever(forgets: bool) -> None:
    lag = Lag()
    lag.wrote(700, seen=5, now=10.0)
    if forgets:
        lag.forget()
    assert lag.blind(11.0) is not forgets
    assert not lag.blind(10.0 + LONGEST)


class Watched(crowds.Crowd):
    """A crowd that notes what a robot writes while it has not seen its own last write."""

    def __init__(self, robots: int) -> None:
        super().__init__(robots)
        self.too_early: List[str] = []
        self._wrote: Dict[int, int] = defaultdict(int)

    def _carry_out(self, index: int, decision: ev.Decision, inbox: List[ev.Event]) -> None:
        if isinstance(decision, ev.Transact):
            kind = decision.tag.split(" ")[0]
            bids = kind == "bids" and '"reason": ""' in decision.txn.puts[0].value
            view = self.agents[index].view
            if (kind == "claim" or bids) and view.revision < self._wrote[index]:
                self.too_early.append(f"{view.revision} {decision}")
            super()._carry_out(index, decision, inbox)
            answer = self._inboxes[index][-1]
            if kind in ("claim", "bids", "report") and isinstance(answer, ev.Answered):
                assert answer.result is not None
                # What is under way at this moment was decided before the answer.
                self._answers[index] = answer.result.revision if answer.result.done else 0
        else:
            super()._carry_out(index, decision, inbox)

    _answers: Dict[int, int] = {}

    def _act(self, index: int) -> None:
        self._wrote[index] = max(self._wrote[index], self._answers.pop(index, 0))
        super()._act(index)


def test_nothing_is_bid_or_claimed_before_the_own_last_write_is_seen() -> None:
    crowd: Any = joined(30, Watched)
    crowd.behind = 1.0
    crowd.send(60)
    crowd.until(lambda: crowd.written(records.ENDS) == 60)
    assert not crowd.too_early
    assert sorted(goal for goal, _ in crowd.begun) == sorted(crowd.best)


def test_a_record_is_parsed_once_for_all_robots_of_a_process(monkeypatch: pytest.MonkeyPatch) -> None:
    parsed: List[str] = []
    read = records.json.loads
    monkeypatch.setattr(records.json, "loads", lambda text: (parsed.append(text), read(text))[1])
    crowd = joined(2)
    parsed.clear()
    goal = Goal("once", ("(done)",), 1234.5)
    crowd.store.transact(Txn((), (Put(KEYS.key(records.GOALS, "once"), records.encode(goal)),)))
    crowd.until(lambda: crowd.written(records.ENDS) == 1)
    views = [FleetView.of(KEYS, crowd.store.snapshot()) for _ in range(3)]
    assert {view.goals["once"].sent for view in views} == {1234.5}
    assert parsed.count(records.encode(goal)) == 1

# SPDX-License-Identifier: Apache-2.0
"""A system that an earlier trial has left broken: its next trial says so, and counts."""

import time
from typing import Any, Dict, List, Optional

import pytest
from chaos import runner, table
from chaos.before import BrokenBefore, Missed, ended_before
from chaos.faults import all_faults
from chaos.judging import events
from chaos.judging.events import Event, EventLog
from chaos.judging.evidence import Evidence
from chaos.judging.rules import every_node_is_back
from chaos.moments import Moment
from chaos.result import Result
from chaos.trials import Trial

POINTS = {"kitchen": (9.0, 9.0), "bath": (8.0, 8.0)}
SPEAKING = Trial("listen:kill", all_faults()["listen:kill"], Moment.SPEAKING)


def ended(outcome: str, reason: str = "") -> Event:
    return Event(1.0, events.ENDED, {"label": "request", "outcome": outcome, "reason": reason})


class Broken:
    """A system whose requests end with a given outcome, before anything begins."""

    def __init__(self, outcome: str, takes_facts: bool = True) -> None:
        self.log = EventLog()
        self.log.add(Event(time.monotonic(), events.TRUTH, {"x": 0.0, "y": 0.0, "speed": 0.0, "turn": 0.0}))
        self.nodes = ["listen"]
        self.outcome, self.takes_facts = outcome, takes_facts

    def tell_client(self, do: str, **words: Any) -> None:
        if do == "prepare":
            if self.takes_facts:
                self.add("prepared")
            else:
                self.add("failed", do=do, error="nothing offers it")
        if do == "send" and self.outcome:
            self.add(
                events.ENDED, label=words["label"], outcome=self.outcome, reason="listen is gone", action=""
            )

    def add(self, kind: str, **data: Any) -> None:
        self.log.add(Event(time.monotonic(), kind, data))

    def pid(self, target: str) -> Optional[int]:
        return None

    def kill(self, reason: str) -> None:
        self.log.close(reason)


def run(system: Broken, count: int = 1, trial: Trial = SPEAKING) -> List[Result]:
    trials = runner.Runner(system, POINTS)  # type: ignore[arg-type]
    return [trials.run(trial) for _ in range(count)]


def test_a_request_that_fails_by_itself_is_a_violation_and_names_the_earlier_trial() -> None:
    fresh, later = run(Broken("ACTION_FAILED"), 2)
    for result in (fresh, later):
        assert result.judgement is not None and not result.clean and not result.struck
    words = fresh.judgement.violations[0]  # type: ignore[union-attr]
    assert "on a fresh system: the request ended before its moment: ACTION_FAILED: listen is gone" in words
    assert "after the trial 'listen:kill @speaking'" in later.judgement.violations[0]  # type: ignore[union-attr]
    assert [event.kind for event in later.log][-1] == events.ENDED


@pytest.mark.parametrize("outcome", ["SUCCEEDED", "ALREADY_TRUE", "CANCELLED"])
def test_a_request_that_was_too_fast_says_nothing(outcome: str) -> None:
    (result,) = run(Broken(outcome))
    assert result.judgement is None and "ended before its moment" in result.note
    assert isinstance(ended_before(ended(outcome)), Missed)


@pytest.mark.parametrize("outcome", ["UNSOLVABLE", "CANCEL_TIMEOUT", "REFUSED", "PLANNING_FAILED"])
def test_every_other_end_does(outcome: str) -> None:
    assert isinstance(ended_before(ended(outcome, "why")), BrokenBefore)


def test_a_request_that_hangs_is_a_violation(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, "MOMENT_LIMIT", 0.05)
    (result,) = run(Broken(""))
    assert not result.struck
    assert "the moment 'speaking' did not come" in result.judgement.violations[0]  # type: ignore[union-attr]


def test_a_knowledge_base_that_takes_no_facts_is_a_violation() -> None:
    (result,) = run(Broken("", takes_facts=False))
    assert "takes no facts: nothing offers it" in result.judgement.violations[0]  # type: ignore[union-attr]


def test_a_node_that_is_missing_is_a_violation() -> None:
    system = Broken("")
    tell = system.tell_client

    def speaks(do: str, **words: Any) -> None:
        tell(do, **words)
        if do == "send":
            system.add(events.GOALS, server="sound_play", active=["goal"])

    system.tell_client = speaks  # type: ignore[method-assign]
    (result,) = run(system)
    assert "listen does not run" in result.judgement.violations[0]  # type: ignore[union-attr]


@pytest.mark.parametrize("nodes, bad", [([], 0), (["listen"], 1)])
def test_every_node_is_back_at_the_end(nodes: List[str], bad: int) -> None:
    log = [Event(0.0, events.FAULT), Event(9.0, events.MISSING, {"nodes": nodes})]
    assert len(every_node_is_back(Evidence(SPEAKING, log, POINTS, []))) == bad


def test_it_has_a_line_of_its_own_in_the_table_and_what_did_not_count_is_said() -> None:
    broken, fast = run(Broken("ACTION_FAILED"))[0], run(Broken("SUCCEEDED"))[0]
    rows: List[Dict[str, str]] = [table.row(1, broken, False), table.row(2, fast, False)]
    line, every = table.summary(rows)
    assert (line[0], line[2], line[-1]) == (table.UNTOUCHED, "1", "1") and every[2] == "1"
    assert "the fault 'listen:kill @speaking' was not done" in rows[0]["note"]
    last = table.text(rows).splitlines()[-1]
    assert last.startswith("1 did not count: not valid: the request ended before its moment: SUCCEEDED")

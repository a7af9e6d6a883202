"""The log that waits, and the tables."""

import threading
import time
from pathlib import Path

import pytest
from chaos import table
from chaos.events import Event, EventLog, LogClosed
from chaos.faults import all_faults
from chaos.moments import Moment
from chaos.rules import Judgement
from chaos.runner import Result
from chaos.trials import Trial


def test_a_wait_ends_with_the_event() -> None:
    log = EventLog()
    threading.Timer(0.05, log.add, [Event(1.0, "x", {"a": 3})]).start()
    found = log.wait_for(0, lambda event: event["a"] if event.kind == "x" else None, 1e9, time.monotonic)
    assert found == 3


def test_a_wait_ends_with_its_time_and_with_the_log() -> None:
    log = EventLog()
    assert log.wait_for(0, lambda event: event, time.monotonic() + 0.01, time.monotonic) is None
    log.close("over")
    with pytest.raises(LogClosed, match="over"):
        log.wait_for(0, lambda event: event, time.monotonic() + 9.0, time.monotonic)


def test_events_of_two_witnesses_are_put_in_order() -> None:
    log = EventLog()
    for at in (3.0, 1.0, 2.0):
        log.add(Event(at, "x"))
    assert [event.at for event in log.since(0)] == [1.0, 2.0, 3.0]


def test_rows_become_a_table(tmp_path: Path) -> None:
    trial = Trial("navigation:kill", all_faults()["navigation:kill"], Moment.DRIVING)
    rows = tmp_path / "trials.csv"
    for number, stand in enumerate((0.2, 0.6, 0.4)):
        violations = ("too late",) if number == 1 else ()
        result = Result(trial, Judgement(violations, stand, 1.0, None, "ACTION_FAILED"))
        table.append(rows, table.row(number, result, fresh=number == 0))
    table.append(rows, table.row(4, Result(trial, None, "not valid: it was over"), fresh=False))
    first, total = table.summary(table.read(rows))
    assert first == ("navigation:kill", "driving", "3", "0.40 / 0.60", "1.00 / 1.00", "–", "1")
    assert total[2] == "3"
    assert "| navigation:kill | driving | 3 | 0.40 / 0.60 |" in table.markdown(table.read(rows))

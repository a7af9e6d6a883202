# SPDX-License-Identifier: Apache-2.0
"""The log that waits, and the tables."""

import threading
import time
from pathlib import Path
from typing import Dict

import pytest
from chaos import table
from chaos.faults import all_faults
from chaos.judging.events import Event, EventLog, LogClosed
from chaos.judging.rules import Judgement
from chaos.moments import Moment
from chaos.result import Result
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


def fields(name: str, moment: str, violations: str = "", stand: str = "") -> Dict[str, str]:
    made = dict.fromkeys(table.COLUMNS, "")
    made.update(name=name, moment=moment, valid="1", respawn="1", violations=violations, stand_s=stand)
    return made


def test_a_page_has_a_line_per_fault_and_pairs_share_theirs() -> None:
    rows = [
        fields("navigation:kill", "driving", stand="0.2"),
        fields("navigation:kill", "driving", "too late", stand="0.4"),
        fields("navigation:kill", "idle"),
        fields("merlin_bridges+navigation:kill", "idle"),
        fields("merlin_executor+navigation:kill", "idle"),
    ]
    heads, _, one, pairs, every = table.markdown(rows).splitlines()
    assert heads.startswith("| fault | driving | speaking | listening | planning | between | idle |")
    assert one == "| navigation:kill | 2, 1 bad |  |  |  |  | 1 |  | 0.30 / 0.40 | – | – | 1 | 3 |"
    assert pairs.startswith("| two nodes:kill |  |  |  |  |  | 2 |")
    assert every.endswith("| 1 | 5 |")


def test_the_table_takes_the_place_of_the_one_between_the_marks(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(f"before\n{table.BEGIN}\n| old |\n{table.END}\nafter\n")
    for _ in range(2):
        table.write_into(page, [fields("navigation:kill", "idle")])
    text = page.read_text()
    assert "old" not in text
    assert text.startswith(f"before\n{table.BEGIN}\n| fault |")
    assert text.endswith(f"|\n{table.END}\nafter\n")
    page.write_text("no marks")
    with pytest.raises(ValueError, match="has no lines"):
        table.write_into(page, [])

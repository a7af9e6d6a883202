# SPDX-License-Identifier: Apache-2.0
"""What happened is read afterwards, as text and as JSON, also while the monitor still writes."""

import contextlib
import json
import sqlite3
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from merlin_monitor.state.history_events import Event
from merlin_monitor.state.history_store import HistoryStore
from merlin_monitor.terminal import history_command
from merlin_test import LONG

pytestmark = pytest.mark.everywhere


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "history.sqlite"
    for number in (1, 2):
        store = HistoryStore(path, 1000)
        store.add(Event("goal", f"(checked room_{number}) asked for", 1.0))
        store.add(Event("action", f"(ask room_{number}) succeeded", 2.0, {"outcome": "succeeded"}))
        store.close()
    return path


def said(monkeypatch: pytest.MonkeyPatch, capsys: Any, *words: Any) -> Any:
    monkeypatch.setattr(sys, "argv", ["history", *map(str, words)])
    said.code = history_command.main()
    out, said.errors = capsys.readouterr()
    return out


def test_the_last_run_is_shown(file: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    head, goal, action = said(monkeypatch, capsys, file).splitlines()
    assert head.startswith("run 2, 20")
    assert goal.endswith("  goal       (checked room_2) asked for")
    assert action.endswith("  action     (ask room_2) succeeded")


def test_of_robots_that_share_a_file_the_last_runs_are_shown(
    file: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    for launch in (1, 2):
        stores = {
            name: HistoryStore(file, 1000, session=f"{launch} /{name}/monitor") for name in ("ann", "bob")
        }
        for text in ("asked for", "succeeded"):
            for name, store in stores.items():
                store.add(Event("goal", f"({name} {launch}) {text}", 1.0))
                store.page().result(LONG)
        for store in stores.values():
            store.close()
    lines = said(monkeypatch, capsys, file).splitlines()
    assert lines[0].startswith("run 5, 20") and lines[0].endswith(", /ann")
    assert lines[3].startswith("run 6, 20") and lines[3].endswith(", /bob")
    assert [line.partition("(")[2] for line in lines if not line.startswith("run")] == [
        "ann 2) asked for",
        "ann 2) succeeded",
        "bob 2) asked for",
        "bob 2) succeeded",
    ]
    assert ", 2 events, /bob" in said(monkeypatch, capsys, file, "--runs")


def test_runs_and_kinds_can_be_chosen(file: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    events = json.loads(said(monkeypatch, capsys, file.parent, "--all", "--kind", "action", "--json"))
    assert [event["text"] for event in events] == ["(ask room_1) succeeded", "(ask room_2) succeeded"]
    assert events[0]["detail"] == {"outcome": "succeeded"}
    (event,) = json.loads(said(monkeypatch, capsys, file, "--run", 1, "--kind", "goal", "--json"))
    assert (event["run"], event["text"]) == (1, "(checked room_1) asked for")
    assert len(json.loads(said(monkeypatch, capsys, file, "--since", "1d", "--json"))) == 4
    runs = json.loads(said(monkeypatch, capsys, file, "--runs", "--json"))
    assert [(run["run"], run["events"]) for run in runs] == [(1, 2), (2, 2)]
    assert "run 1, 20" in said(monkeypatch, capsys, file, "--runs")


def test_a_history_that_is_still_written_is_read(
    file: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    store = HistoryStore(file, 1000)
    store.add(Event("goal", "(checked hall) asked for", 1.0))
    store.page().result(LONG)  # until it is written
    assert "(checked hall) asked for" in said(monkeypatch, capsys, file)
    store.close()


def test_a_file_of_the_first_version_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    with contextlib.closing(sqlite3.connect(tmp_path / "history.sqlite")) as file, file:
        file.execute("CREATE TABLE runs (id INTEGER PRIMARY KEY, began REAL)")
        columns = "run INTEGER, wall REAL, at REAL, kind TEXT, text TEXT, detail TEXT"
        file.execute(f"CREATE TABLE events (id INTEGER PRIMARY KEY, {columns})")
        file.execute("INSERT INTO runs VALUES (1, 1.7e9)")
        file.execute("INSERT INTO events VALUES (1, 1, 1.7e9, 2.0, 'goal', '(checked hall) asked for', '{}')")
    assert "(checked hall) asked for" in said(monkeypatch, capsys, tmp_path)
    (event,) = json.loads(said(monkeypatch, capsys, tmp_path, "--json"))
    assert (event["at"], event["detail"], said.errors) == (2.0, {}, "")


def test_no_text_can_move_the_cursor_or_forge_a_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    store = HistoryStore(tmp_path / "history.sqlite", 1000)
    heard = "heard \x1b]0;pwned\x07\x9b2J\nrun 9, 2020-01-01 \ud83d"
    store.add(Event("speech", heard, 1.0, {heard: [heard]}))
    store.close()
    run, event = said(monkeypatch, capsys, tmp_path).splitlines()
    assert event.isprintable() and run.startswith("run 1") and "run 9" in event
    printed = said(monkeypatch, capsys, tmp_path, "--json")
    assert all(line.isprintable() for line in printed.splitlines())
    (event,) = json.loads(printed)
    ((key, (value,)),) = event["detail"].items()
    assert event["text"] == key == value == heard.replace("\ud83d", "?")


def test_json_of_an_older_file_with_half_a_letter_is_printed(
    file: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    with contextlib.closing(sqlite3.connect(file)) as connection, connection:
        connection.execute("UPDATE events SET detail = ?", (json.dumps({"what": "why \ud83d"}),))
    assert json.loads(said(monkeypatch, capsys, file, "--json"))[0]["detail"] == {"what": "why \ud83d"}


def test_what_cannot_be_read_is_said(
    file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    said(monkeypatch, capsys, tmp_path / "none.sqlite")
    assert said.code == 2 and "there is no history" in said.errors
    (tmp_path / "text").write_text("This is a text, and no history at all, whatever its name may be.\n" * 20)
    said(monkeypatch, capsys, tmp_path / "text")
    assert said.code == 2 and "is not a history" in said.errors
    said(monkeypatch, capsys, file, "--run", 7)
    assert said.code == 2 and "there is no run 7; there are: 1 to 2" in said.errors


def test_a_later_launch_without_a_history_is_named(tmp_path: Path) -> None:
    log = tmp_path / "roslaunch-robot-1.log"
    log.write_text("[xmlrpc][INFO] 2026-03-01 12:00:00,059: XML-RPC server binding\n")
    began = time.mktime((2026, 3, 1, 12, 0, 0, 0, 0, -1))
    assert "the launch of 2026-03-01 12:00:00" in str(history_command.later_launch(tmp_path, began - 1.0))
    assert history_command.later_launch(tmp_path, began + 1.0) is None
    assert history_command.later_launch(tmp_path / "nothing", 0.0) is None

# SPDX-License-Identifier: Apache-2.0
"""A folder that cannot be opened is one line that says why; a recording brings no foreign scripts."""

import contextlib
import sqlite3
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from merlin_monitor.history.history_file import HistoryError
from merlin_monitor.panel_scripts import script_file
from merlin_monitor.state.history_store import HistoryStore
from merlin_monitor.state.inbox import Inbox
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_monitor.web import open_command
from merlin_monitor.web.open_command import Archive
from merlin_test import LONG


def kept(folder: Path, panels: Any) -> Path:
    """The history of a run that showed these panels."""
    state = MonitorModel(Inbox(), HistoryStore(folder / "history.sqlite", 1000))
    state.tree.set("meta", "panels", panels)
    state.start()
    state.stop()
    return folder


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("", None, "there is no history"),
        ("x" * 300, None, "cannot be read: File name too long"),  # as one in the folder of another user
        (
            "history.sqlite",
            "a text of some length that is not a database at all " * 20,
            "not a history, or damaged",
        ),
        ("history.sqlite", "", "another program"),
    ],
)
def test_what_is_no_history_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any, name: str, content: Any, said: str
) -> None:
    if content is not None:
        (tmp_path / name).write_text(content)
    monkeypatch.setattr(sys, "argv", ["open", str(tmp_path / ("" if content is not None else name))])
    assert open_command.main() == open_command.EXIT_MISTAKES
    out, errors = capsys.readouterr()
    assert out == "" and errors.count("\n") == 1 and said in errors


def test_a_name_that_no_host_has_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    kept(tmp_path, [])
    monkeypatch.setattr(sys, "argv", ["open", str(tmp_path), "--port", "0", "--allowed-host", "http://lab"])
    assert open_command.main() == open_command.EXIT_MISTAKES
    assert capsys.readouterr().err.startswith("open: --allowed-host http://lab names no host; give it as")


def test_a_last_state_without_panels_is_damaged(tmp_path: Path) -> None:
    with pytest.raises(HistoryError, match="damaged"):
        Archive(kept(tmp_path, None), "name")


def test_a_last_segment_that_cannot_be_read_hides_no_other(tmp_path: Path) -> None:
    panel = {
        "name": "plan",
        "title": "Plan",
        "width": 3,
        "script": "package://merlin_monitor/web/panels/plan.js",
    }
    file = kept(tmp_path, [panel]) / "history.sqlite"
    kept(tmp_path, [])
    with contextlib.closing(sqlite3.connect(str(file))) as history, history:
        history.execute("UPDATE frames SET data = zeroblob(9) WHERE run = 2")
    archive = Archive(tmp_path, "name")
    assert [shown["name"] for shown in archive.tree.get("meta", "panels")] == ["plan"]
    archive.stop()


def test_panels_that_are_announced_after_the_first_frame_are_shown(tmp_path: Path) -> None:
    state = MonitorModel(Inbox(), HistoryStore(tmp_path / "history.sqlite", 1000))
    state.start()
    end = time.monotonic() + LONG
    while not [run for run in state.history.runs().result(LONG) if run["bytes"]]:
        assert time.monotonic() < end
        time.sleep(0.01)
    panel = {
        "name": "plan",
        "title": "Plan",
        "width": 3,
        "script": "package://merlin_monitor/web/panels/plan.js",
    }
    state.tree.set("meta", "panels", [panel])
    state.stop()
    archive = Archive(tmp_path, "name")
    assert [shown["name"] for shown in archive.tree.get("meta", "panels")] == ["plan"]
    archive.stop()


def test_only_scripts_of_packages_are_served(tmp_path: Path) -> None:
    def panel(name: str, script: str) -> Any:
        return {"name": name, "title": name, "width": 3, "script": script}

    good = panel("plan", "package://merlin_monitor/web/panels/plan.js")
    bad = [
        panel("up", "package://merlin_monitor/web/../../../etc/x.js"),
        panel("file", "file:///etc/passwd"),
        panel("../x", good["script"]),
        panel("gone", "package://nowhere/x.js"),
        panel("long", f"package://merlin_monitor/{'x' * 300}.js"),
    ]
    archive = Archive(kept(tmp_path, [good, *bad]), "name")
    assert archive.tree.get("meta", "panels") == [good]
    assert archive.scripts == {"plan": script_file(good["script"])}
    assert len(archive.missing) == len(bad)
    archive.stop()

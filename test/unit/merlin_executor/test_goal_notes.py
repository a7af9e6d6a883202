# SPDX-License-Identifier: Apache-2.0
"""Goals that are noted in a file: after a power cut it holds the old list or the new one."""

import os
import shutil
from pathlib import Path
from typing import Any

import pytest

from merlin_executor.goals.goal_ledger import GoalNotes


def test_what_is_noted_is_on_the_disk_before_the_goal_is_added(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    notes, done = GoalNotes(str(tmp_path / "goals")), []
    fsync, replace = os.fsync, os.replace

    def note_fsync(number: int) -> None:
        fsync(number)
        done.append(Path(os.readlink(f"/proc/self/fd/{number}")).name)

    def note_replace(*paths: Any) -> None:
        replace(*paths)
        done.append("replaced")

    monkeypatch.setattr(os, "fsync", note_fsync)
    monkeypatch.setattr(os, "replace", note_replace)
    notes.write(["(checked hall)"])
    assert done == ["goals.new", "replaced", tmp_path.name]
    assert GoalNotes(str(notes.path)).read() == ["(checked hall)"]


def test_that_nothing_is_left_need_not_be_on_the_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    notes = GoalNotes(str(tmp_path / "goals"))
    notes.write(["(checked hall)"])
    monkeypatch.setattr(os, "fsync", lambda number: pytest.fail("a sync costs time"))
    notes.write([])
    assert notes.read() == []


def test_a_folder_that_was_removed_is_made_again(tmp_path: Path) -> None:
    notes = GoalNotes(str(tmp_path / "robot" / "goals"))
    shutil.rmtree(tmp_path / "robot")
    notes.write(["(checked hall)"])
    assert GoalNotes(str(notes.path)).read() == ["(checked hall)"]


def test_of_a_full_disk_the_file_is_named(tmp_path: Path) -> None:
    notes = GoalNotes(str(tmp_path / "goals"))
    (tmp_path / "goals.new").symlink_to("/dev/full")
    with pytest.raises(OSError, match=f"{notes.path} cannot be written: No space left on device"):
        notes.write(["(checked hall)"])


def test_a_folder_in_the_place_of_the_file_is_refused_at_once(tmp_path: Path) -> None:
    with pytest.raises(IsADirectoryError, match=str(tmp_path)):
        GoalNotes(str(tmp_path))


def test_a_file_that_cannot_be_replaced_is_refused_at_once(tmp_path: Path) -> None:
    (tmp_path / "goals.new").mkdir()  # as a folder that is read only, which root can write into
    with pytest.raises(IsADirectoryError, match=str(tmp_path)):
        GoalNotes(str(tmp_path / "goals"))
    GoalNotes(str(tmp_path / "others"))
    assert sorted(path.name for path in tmp_path.glob("others*")) == ["others"]

# SPDX-License-Identifier: Apache-2.0
"""Folders of nodes that were killed do not pile up, and no other folder is touched."""

import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from merlin_rosplan.supervision.scratch_folder import ScratchFolder

pytestmark = pytest.mark.everywhere

HOLD = """
import sys
from merlin_rosplan.supervision.scratch_folder import ScratchFolder

folder = ScratchFolder("kind")
open(folder.name + "/plan", "w").close()
print(folder.name, flush=True)
sys.stdin.read()
"""


@pytest.fixture(autouse=True)
def own_tmp(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setenv("TMPDIR", str(tmp_path))


def make_another() -> None:
    folder = ScratchFolder("kind")
    assert os.path.isdir(folder.name)
    folder.cleanup()


def make_old(folder: Path) -> None:
    os.utime(folder, (1.0, 1.0))


def test_a_folder_goes_with_its_process(tmp_path: Path) -> None:
    folder = ScratchFolder("kind")
    assert not list(tmp_path.iterdir())  # made when it is first asked for
    assert Path(folder.name).parent == tmp_path
    folder.cleanup()
    assert not list(tmp_path.iterdir())


def test_the_folder_of_a_killed_process_is_removed_by_the_next_and_that_of_a_living_one_is_not(
    tmp_path: Path,
) -> None:
    command = [sys.executable, "-c", HOLD]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        folder = Path(process.stdout.readline().strip())
        assert folder.parent == tmp_path
        try:
            make_old(folder)
            make_another()
            assert folder.is_dir()
        finally:
            process.send_signal(signal.SIGKILL)
            process.wait()
    make_old(folder)
    make_another()
    assert not list(tmp_path.iterdir())


def test_what_is_new_or_of_another_kind_or_a_link_stays(tmp_path: Path) -> None:
    young, other, target = tmp_path / "kind-young", tmp_path / "others-1", tmp_path / "target"
    for folder in (young, other, target):
        folder.mkdir()
    for folder in (other, target):
        make_old(folder)
    (tmp_path / "kind-link").symlink_to(target)
    make_another()
    assert young.is_dir() and other.is_dir() and target.is_dir()

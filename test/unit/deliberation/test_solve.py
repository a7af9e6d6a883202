# SPDX-License-Identifier: Apache-2.0
"""The command: its table, and mistakes that are one sentence and exit code 2."""

import importlib.metadata
import os
from pathlib import Path
from typing import List

import pytest

from deliberation.problems import Run, run_of, table
from deliberation.solve import main


def run(seed: int, solved: bool = True) -> Run:
    return Run(3, seed, solved, 20 + seed, 5, 18.5, 30.0, 4, 1.5, 1, 1, [])


def test_the_table_has_the_means_of_each_problem() -> None:
    lines = list(table([run(1), run(3, solved=False)]))
    assert lines[2].startswith("| 3, containers | 1 of 2 | 22.0 | 5.0 | 18.5 | 30.0 | 4.0 | 1.5 | 2 | 2 |")


def test_a_run_comes_back_from_its_file() -> None:
    assert run_of(run(1).as_data()) == run(1)


def missing(name: str) -> str:
    raise importlib.metadata.PackageNotFoundError(name)


def test_ctrl_c_leaves_the_end_to_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rosrun = tmp_path / "rosrun"
    rosrun.write_text("#!/bin/sh\nkill -INT $PPID\nexit 130\n")
    rosrun.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    monkeypatch.setattr(importlib.metadata, "version", lambda name: "5.0.1")
    assert main(["--results", str(tmp_path), "--seeds", "2"]) == 130


@pytest.mark.parametrize(
    ("version", "words", "said"),
    [
        (missing, [], "pyrobosim is not installed; run `make build PROFILE=robot+deliberation`"),
        (lambda name: "4.0.0", [], "pyrobosim 4.0.0 is installed, and 5.0.1 is needed"),
        (lambda name: "5.0.1", ["--problem", "7"], "there is no problem 7; the problems are 1, 2, 3, 4"),
        (lambda name: "5.0.1", ["--seeds", "0"], "--seeds has to be at least 1"),
        (lambda name: "5.0.1", ["--rtf", "nan"], "--rtf more than 0"),
        (lambda name: "5.0.1", ["--world", "nowhere.yaml"], "there is no world nowhere.yaml"),
    ],
)
def test_a_mistake_is_one_sentence(
    version: object,
    words: List[str],
    said: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(importlib.metadata, "version", version)
    assert main(words) == 2
    errors = capsys.readouterr().err.strip().splitlines()
    assert len(errors) == 1 and said in errors[0]

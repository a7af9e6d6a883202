# SPDX-License-Identifier: Apache-2.0
"""The problems of examples/deliberation in pyrobosim, in processes of their own."""

import importlib.util
import json
import subprocess
from pathlib import Path
from typing import Any, Dict

import pytest

pytestmark = [
    pytest.mark.processes,
    pytest.mark.skipif(
        importlib.util.find_spec("pyrobosim") is None,
        reason="pyrobosim is not installed: make build PROFILE=all+deliberation",
    ),
]


def solved(folder: Path, problem: int, seed: int, *options: str) -> Dict[str, Any]:
    """What is kept of a run that was solved."""
    words = ["--problem", str(problem), "--seed", str(seed), "--results", str(folder), *options]
    done = subprocess.run(
        ["rosrun", "deliberation", "solve", *words], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    file = folder / f"problem_{problem}_seed_{seed}" / "run.json"
    run: Dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    assert run["solved"] and run["wrong"] == []
    return run


def test_things_are_found_and_fetched_through_a_cancel_and_an_urgent_request(tmp_path: Path) -> None:
    run = solved(tmp_path, 1, 1, "--cancels", "1", "--rtf", "10")
    assert (run["cancels"], run["urgent"]) == (1, 1)


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_battery_is_charged_in_time_while_actions_fail(seed: int, tmp_path: Path) -> None:
    run = solved(tmp_path, 4, seed, "--cancels", "1", "--rtf", "10")
    assert run["failed"] > 0


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("world:=nowhere.yaml", "there is no world nowhere.yaml"),
        ("goals:=(is_near mug table)", "none that can be compared with the simulation"),
        ("goals:=(is_at cup table)", "names cup, which is not in this world"),
    ],
)
def test_a_mistake_ends_with_one_sentence(word: str, said: str, tmp_path: Path) -> None:
    command = ["rosrun", "merlin", "run", "deliberation", "deliberation.launch", word]
    done = subprocess.run(
        [*command, "monitor:=false", f"results:={tmp_path}"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert said in done.stdout + done.stderr

"""The restaurant as its users start it: a short evening with one guest who comes and one who sits there."""

import csv
import os
import subprocess
import sys
from pathlib import Path

import pytest

RUN = [
    sys.executable,
    "-c",
    "from merlin.launch_runner import main; raise SystemExit(main())",
    "restaurant.launch",
]


def run(tmp_path: Path, *words: str) -> "subprocess.CompletedProcess[str]":
    env = dict(os.environ, ROS_HOME=str(tmp_path), ROS_LOG_DIR=str(tmp_path / "log"))
    env.pop("ROS_MASTER_URI", None)
    command = [*RUN, f"results:={tmp_path / 'results'}", *words]
    return subprocess.run(command, env=env, capture_output=True, text=True, timeout=270, check=False)


def test_a_short_evening_balances(tmp_path: Path) -> None:
    done = run(tmp_path, "guests:=1", "disturbances:=0", "wrong_share:=1", "haste:=8", "seed:=3", "rtf:=5")
    assert done.returncode == 0, done.stdout + done.stderr
    with (tmp_path / "results" / "guests.csv").open() as file:
        (ann,) = csv.DictReader(file)
    assert ann["outcome"] == "served"
    assert ann["ordered"] == ann["served"] != ""
    assert "the order is wrong at the bar" in ann["errors"]
    assert (tmp_path / "results" / "timeline.png").read_bytes().startswith(b"\x89PNG")
    for line in ("says", "understands", "sees", "knows", "(deliver_order"):
        assert f"robot   {line}" in done.stdout
    assert "the books balance" in done.stdout


@pytest.mark.parametrize(
    ("word", "text"), [("guests:=12", "12 guests cannot be"), ("world_file:=/nowhere.yaml", "/nowhere.yaml")]
)
def test_bad_input_is_said(tmp_path: Path, word: str, text: str) -> None:
    done = run(tmp_path, word)
    assert done.returncode != 0
    assert text in done.stderr
    assert "Traceback" not in done.stderr

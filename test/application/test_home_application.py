"""The home application as its users start it: `rosrun merlin run home.launch …`."""

import csv
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import List, Tuple

import pytest
import rosbag

from merlin_home.mission_list import make_mission

RUN = [sys.executable, "-c", "from merlin.launch_runner import main; raise SystemExit(main())", "home.launch"]
POINTS = ["dorm_room", "bathroom", "kitchen", "main_door"]


def start(tmp_path: Path, *words: str) -> subprocess.Popen:
    env = dict(os.environ, ROS_HOME=str(tmp_path), ROS_LOG_DIR=str(tmp_path / "log"))
    env.pop("ROS_MASTER_URI", None)
    command = [*RUN, f"results:={tmp_path / 'results'}", *words]
    return subprocess.Popen(command, env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def end(process: subprocess.Popen) -> Tuple[int, List[str], List[str]]:
    out, err = process.communicate(timeout=200)
    return process.returncode, out.splitlines(), err.splitlines()


def test_a_short_mission_ends_as_listed_and_leaves_its_tables(tmp_path: Path) -> None:
    code, out, err = end(start(tmp_path, "tasks:=2", "seed:=1", "rtf:=4", "record:=true"))
    assert code == 0, "\n".join(out + err)
    results = tmp_path / "results"
    with (results / "runs.csv").open() as file:
        (run,) = csv.DictReader(file)
    assert (run["ended"], run["tasks"], run["marked"], run["right"]) == ("complete", "2", "1", "2")
    with (results / "tasks.csv").open() as file:
        tasks = list(csv.DictReader(file))
    listed = make_mission(POINTS, 2, 1)
    assert [(row["poi"], row["marked"]) for row in tasks] == [
        (task.poi, str(int(task.marked))) for task in listed
    ]
    for row in tasks:
        assert float(row["distance_m"]) > 1.0
        assert 0.0 < float(row["efficiency"]) <= 1.0
        assert row["outcome"] == ("CANCELLED" if row["marked"] == "1" else "SUCCEEDED")
    assert (results / "path.png").read_bytes().startswith(b"\x89PNG")
    with rosbag.Bag(str(results / "run.bag")) as bag:
        topics = bag.get_type_and_topic_info().topics
    assert {"/merlin/status", "/ground_truth", "/cmd_vel", "/merlin/mission"} <= set(topics)
    assert any(line.startswith("2/2") for line in out)
    assert str(results / "runs.csv") in "\n".join(out)


def test_the_plain_mission_that_newcomers_copy_ends_as_listed(tmp_path: Path) -> None:
    code, out, err = end(start(tmp_path, "measure:=false", "tasks:=2", "seed:=1", "rtf:=4"))
    assert code == 0, "\n".join(out + err)
    assert not list(tmp_path.glob("results/*.csv"))


@pytest.mark.parametrize(
    ("word", "code", "text"),
    [("points:=kitchen garage", 1, "garage"), ("marked_share:=0.3", 2, "is not a whole number")],
)
def test_bad_input_of_the_plain_mission_is_one_line(tmp_path: Path, word: str, code: int, text: str) -> None:
    ended, out, err = end(start(tmp_path, "measure:=false", "tasks:=2", word))
    ours = [line for line in err if "mission" in line and text in line]
    assert (ended, len(ours)) == (code, 1), "\n".join(out + err)
    assert not any("Traceback" in line for line in err)


def test_an_interrupted_mission_stops_and_keeps_what_it_has(tmp_path: Path) -> None:
    process = start(tmp_path, "tasks:=4", "rtf:=4")
    for line in process.stdout:
        if line.startswith("1/4"):
            break
    process.send_signal(signal.SIGINT)
    code, _, _ = end(process)
    assert code == 130
    with (tmp_path / "results" / "runs.csv").open() as file:
        (run,) = csv.DictReader(file)
    assert run["ended"] == "interrupted"


@pytest.mark.parametrize(
    ("word", "text"),
    [
        ("world:=castle", "castle.yaml"),
        ("domain:=/nowhere.pddl", "/nowhere.pddl"),
        ("problem:=/nowhere.pddl", "/nowhere.pddl"),
        ("points:=kitchen garage", "no garage; it has"),
    ],
)
def test_bad_input_is_one_line(tmp_path: Path, word: str, text: str) -> None:
    code, out, err = end(start(tmp_path, word))
    assert code == 2
    ours = [line for line in err if line.startswith(("mission: ", "merlin run: "))]
    assert len(ours) == 1
    assert text in ours[0]
    assert not any("Traceback" in line for line in err)
    assert not (tmp_path / "results").exists()


@pytest.mark.long
def test_a_pair_in_a_generated_world_ends_as_listed_and_is_reported(tmp_path: Path) -> None:
    env = dict(os.environ, ROS_HOME=str(tmp_path), ROS_LOG_DIR=str(tmp_path / "log"))
    env.pop("ROS_MASTER_URI", None)
    results = tmp_path / "results"
    command = ["rosrun", "merlin_experiment", "experiment", "--worlds", "1", "--rtf", "5"]
    done = subprocess.run([*command, "--results", str(results)], env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    with (results / "runs.csv").open() as file:
        runs = list(csv.DictReader(file))
    assert [(run["set"], run["approach"], run["right"]) for run in runs] == [
        ("worlds", "naive", "6"),
        ("worlds", "merlin", "6"),
    ]
    assert float(runs[1]["time_s"]) < float(runs[0]["time_s"])
    assert "| MERLIN / Naive, time | 1 |" in (results / "report.md").read_text()

# SPDX-License-Identifier: Apache-2.0
"""The home application as its users start it: `rosrun merlin run home.launch …`."""

import csv
import json
import os
import re
import signal
import subprocess
import sys
import time
import urllib.request
from collections import Counter
from pathlib import Path
from typing import Any, Dict, Iterator, List, Tuple

import genpy
import pytest
import rosbag
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from merlin_msgs.msg import MissionStatus
from std_msgs.msg import String

from merlin_home.mission_list import make_mission
from merlin_monitor.bag.bag_import import import_bag
from merlin_monitor.bag.recording import BagRecording
from merlin_monitor.history.history_reader import HistoryReader
from merlin_monitor.state.state_tree import apply_changes
from merlin_ros.health import ENDED as ENDED_WORD
from merlin_ros.health import STALE
from merlin_test.node_path import node_path

EXPERIMENT = Path(__file__).resolve().parents[2] / "bench" / "experiment"
RUN = [node_path("merlin", "run"), "home.launch"]
REPLAY = [sys.executable, "-c", "from merlin.replay.command import main; raise SystemExit(main())"]
LIMIT = 300.0  # s for an answer
GOES_ON = 200.0  # s of ROS time: 10 s of a replay, in which a node that says nothing would be missed
# A machine that tests something else meanwhile may need three times as long as it does alone.
pytestmark = pytest.mark.timeout(1000)
POINTS = ["dorm_room", "bathroom", "kitchen", "main_door"]


def start(tmp_path: Path, *words: str) -> subprocess.Popen:
    env = dict(os.environ, ROS_HOME=str(tmp_path), ROS_LOG_DIR=str(tmp_path / "log"))
    env.pop("ROS_MASTER_URI", None)
    command = [*RUN, f"results:={tmp_path / 'results'}", *words]
    return subprocess.Popen(command, env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def end(process: subprocess.Popen) -> Tuple[int, List[str], List[str]]:
    out, err = process.communicate(timeout=900)
    return process.returncode, out.splitlines(), err.splitlines()


def monitor_of(process: subprocess.Popen) -> str:
    """The address of the page, as the terminal prints it."""
    for line in process.stderr:
        if line.startswith("monitor: http"):
            return line.split()[1]
    raise AssertionError("there is no page")


def until(process: subprocess.Popen, begin: str) -> Iterator[str]:
    """The lines of the screen, up to the one that begins so."""
    for line in process.stdout:
        yield line.rstrip("\n")
        if line.startswith(begin):
            return


def page(address: str) -> Dict[str, Any]:
    """What the page shows, when that is asked for."""
    with urllib.request.urlopen(f"{address}state.json", timeout=LIMIT) as answer:
        return json.load(answer)["state"]


def last_moment(file: Path) -> Dict[str, Any]:
    """What a page showed last, as its history has it: the page itself ends with its run."""
    reader = HistoryReader.of(file)
    (run,) = reader.runs().result(LIMIT)
    first, *later = json.loads(reader.segment(run["run"], run["ended"]).result(LIMIT) or "")["frames"]
    state: Dict[str, Any] = first[2]
    for frame in later:
        apply_changes(state, frame[2])
    state["history"] = {"events": {row["id"]: row for row in reader.export().result(LIMIT)}}
    reader.close()
    return state


#: A goal begins or ends. Its cancels and interruptions name nodes, which a replay has not.
GOAL = re.compile(r"“[^”]*”(?: asked for|:)")


def spoken(phrase: Any) -> Any:
    """A phrase without its English words, whose articles depend on the places that are known by then."""
    if isinstance(phrase, list):
        return [spoken(each) for each in phrase]
    if isinstance(phrase, dict):
        return {key: spoken(value) for key, value in phrase.items() if key != "english"}
    return phrase


def shown(state: Dict[str, Any]) -> Dict[str, Any]:
    """What a replay has to show again: plan, knowledge, and what happened."""
    kinds = ("mission", "goal", "plan", "action")
    events = [event for event in state["history"]["events"].values() if event["kind"] in kinds]
    told = [event["text"] for event in events]
    return {
        "plan": {key: (step["text"], step["state"]) for key, step in state["plan"]["steps"].items()},
        "facts": sorted(state["knowledge"]["facts"]),
        "values": {key: entry["value"] for key, entry in state["knowledge"]["values"].items()},
        "objects": {key: entry["type"] for key, entry in state["knowledge"]["objects"].items()},
        "points": state["map"]["points"],
        "grid": state["map"]["grid"]["width"],
        # At a high rate a mission may be heard after its first request, and the clock goes in large steps. A
        # goal has its sentence once its predicate is known, in a replay later than with the robot.
        "goals": sorted(
            re.sub(r"“ask in the ([^”]*)”", r"“\1 checked”", re.sub(r"after [0-9.]+ s", "", text)).replace(
                "by /mission", "by home mission 1"
            )
            for text in told
            if GOAL.match(text)
        ),
        "plans": [spoken(event["detail"]["said"]) for event in events if event["text"].startswith("plan of")],
    }


ENDED = "home mission 1 has ended: every task ended as listed"


def let_it_go_on(bag: Path) -> float:
    """Lets the recording go on for long after its nodes have ended in order; returns its end, s of ROS time.

    On a busy machine it does so for seconds, or ends before the last words of some.
    """
    with rosbag.Bag(str(bag)) as read:
        end = read.get_end_time()
        found = read.read_messages("/diagnostics", return_connection_header=True)
        headers = {part.name: header for _, reports, _, header in found for part in reports.status}
    with rosbag.Bag(str(bag), "a") as more:
        for name, header in headers.items():
            last = DiagnosticArray(status=[DiagnosticStatus(STALE, name, ENDED_WORD, "", [])])
            more.write("/diagnostics", last, genpy.Time.from_sec(end), connection_header=header)
        more.write("/later", String(), genpy.Time.from_sec(end + GOES_ON))
    return end + GOES_ON


def shown_of(state: Dict[str, Any], live: Dict[str, Any]) -> Dict[str, Any]:
    """What a replay shows of what the page has shown, which may have been late for the first goals."""
    replayed, wanted = shown(state), shown(live)
    goals = Counter(replayed["goals"]) & Counter(wanted["goals"])
    late = max(len(replayed["plans"]) - len(wanted["plans"]), 0)
    return {**replayed, "goals": sorted(goals.elements()), "plans": replayed["plans"][late:]}


def ended_as(state: Dict[str, Any], live: Dict[str, Any], at: float) -> bool:
    """Whether a page shows the end of a recording, and all that was shown at the mission's end."""
    try:
        return state["meta"]["time"] >= at - 1.0 and shown_of(state, live) == shown(live)
    except KeyError:  # one of its parts has published nothing yet
        return False


def check_replay(tmp_path: Path, live: Dict[str, Any], at: float) -> None:
    """Replays the recording at a high rate: at its end the page shows what it showed then.

    :param at: its end, s of ROS time.
    """
    env = dict(os.environ, ROS_HOME=str(tmp_path), ROS_LOG_DIR=str(tmp_path / "log"), TMPDIR=str(tmp_path))
    env["ROS_MASTER_URI"] = "http://localhost:1"  # a robot's, which a replay does not ask
    words = [str(tmp_path / "results"), "--rate", "20", "--keep", "--port", "0"]
    process = subprocess.Popen(
        [*REPLAY, *words], env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        address = monitor_of(process)
        end_at = time.monotonic() + LIMIT
        state: Dict[str, Any] = {}
        # Each topic has a connection of its own: messages of the others may come after the mission's end.
        while not ended_as(state, live, at) and time.monotonic() < end_at:
            time.sleep(0.5)
            state = page(address)
        with rosbag.Bag(str(tmp_path / "results" / "run.bag")) as bag:
            (*_, (_, odometry, _)) = bag.read_messages("/ground_truth")
            (*_, (_, ended, _)) = bag.read_messages("/merlin/mission")
        assert (ended.state, ended.description) == (MissionStatus.SUCCEEDED, "every task ended as listed")
        assert shown_of(state, live) == shown(live)
        assert (state["now"]["doing"], state["now"]["trouble"]) == (ENDED, []), state["now"]
        where = odometry.pose.pose.position
        assert state["map"]["robot"][:2] == pytest.approx([where.x, where.y], abs=0.2)
    finally:
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=LIMIT)
    assert process.returncode == 130, err
    assert not list(tmp_path.glob("merlin-replay-*"))


def check_opened_bag(tmp_path: Path, live: Dict[str, Any]) -> None:
    """Opens the recording as a history: its last moment is what the page showed then."""
    file = tmp_path / "opened.sqlite"
    import_bag(BagRecording(tmp_path / "results" / "run.bag"), file)
    state = last_moment(file)
    assert (state["now"]["doing"], state["now"]["trouble"]) == (ENDED, []), state["now"]
    assert shown_of(state, live) == shown(live)


def test_a_short_mission_ends_as_listed_and_leaves_its_tables(tmp_path: Path) -> None:
    process = start(tmp_path, "tasks:=2", "seed:=1", "rtf:=4", "record:=true", "monitor_port:=0")
    assert "meta" in page(monitor_of(process))
    out = list(until(process, "2/2"))
    code, rest, err = end(process)
    out += rest
    assert code == 0, "\n".join(out + err)
    results = tmp_path / "results"
    live = last_moment(results)
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
    check_replay(tmp_path, live, let_it_go_on(results / "run.bag"))
    check_opened_bag(tmp_path, live)


def test_the_plain_mission_that_newcomers_copy_ends_as_listed(tmp_path: Path) -> None:
    process = start(tmp_path, "measure:=false", "tasks:=2", "seed:=1", "rtf:=4", "linger:=true")
    stays = next((line for line in process.stderr if "the page of this run stays" in line), "")
    if stays:
        state = page(next(word for word in stays.split() if word.startswith("http")))
        process.send_signal(signal.SIGINT)
    code, out, err = end(process)
    assert (code, bool(stays)) == (0, True), "\n".join(out + err)
    assert state["meta"]["archive"] == str(tmp_path / "results")
    events = state["history"]["events"].values()
    assert any(" cancels “" in event["text"] for event in events if event["kind"] == "goal")
    assert any("said “" in event["text"] for event in events if event["kind"] == "speech")
    assert not list(tmp_path.glob("results/*.csv"))


# Starts all nodes for a line that test_home_mission.py finds in the mission alone.
@pytest.mark.long
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
    process = start(tmp_path, "tasks:=4", "rtf:=4", "linger:=true")  # which is not for a run that is ended
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
        pytest.param("domain:=/nowhere.pddl", "/nowhere.pddl", marks=pytest.mark.long),
        pytest.param("problem:=/nowhere.pddl", "/nowhere.pddl", marks=pytest.mark.long),
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
    command = [sys.executable, str(EXPERIMENT), "--worlds", "1", "--rtf", "5"]
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

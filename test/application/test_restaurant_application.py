# SPDX-License-Identifier: Apache-2.0
"""The restaurant as its users start it: short evenings, in which everything goes wrong that can."""

import csv
import os
import re
import signal
import subprocess
from pathlib import Path
from typing import Dict, List

import pytest
from robots.bench_restaurant_lost import evening

from merlin_test.node_path import node_path

RUN = [node_path("merlin", "run"), "restaurant.launch"]

LIMIT = 1300.0  # s of wall time, on a machine that tests something else meanwhile
pytestmark = pytest.mark.timeout(1500)
SHORT = ("haste:=8", "seed:=3", "rtf:=3")


def run(tmp_path: Path, *words: str) -> "subprocess.CompletedProcess[str]":
    env = dict(os.environ, ROS_HOME=str(tmp_path), ROS_LOG_DIR=str(tmp_path / "log"))
    env.pop("ROS_MASTER_URI", None)
    command = [*RUN, f"results:={tmp_path / 'results'}", *words]
    with subprocess.Popen(
        command, env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            out, err = process.communicate(timeout=LIMIT)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGINT)  # it stops all that it has started
            out, err = process.communicate()
            pytest.fail(f"the evening was not over after {LIMIT:g} s\n{out}\n{err}")
    return subprocess.CompletedProcess(command, process.returncode, out, err)


def guests(tmp_path: Path, name: str = "guests.csv") -> List[Dict[str, str]]:
    with (tmp_path / "results" / name).open() as file:
        return list(csv.DictReader(file))


def check_disturbed(done: "subprocess.CompletedProcess[str]", ann: Dict[str, str]) -> None:
    """An item was missing and a chair in the way: what the guest hears, and the evening's table says."""
    assert "an item is missing at the bar" in ann["errors"] and "a chair blocks the way" in ann["errors"]
    complaint = next(line for line in done.stdout.splitlines() if "I am sorry" in line)
    assert any(f"the {item} is missing" in complaint for item in ann["ordered"].split())
    # The guest called while the tables were checked: that had to wait, and went on.
    assert "interrupted by a more urgent request" in done.stdout
    assert "goes on with (checked" in done.stdout
    assert "the books balance" in done.stdout


@pytest.mark.long
def test_a_guest_is_served_though_an_item_is_missing_and_a_chair_in_the_way(tmp_path: Path) -> None:
    done = run(tmp_path, "guests:=1", "disturbances:=missing,chair", "wrong_share:=0", *SHORT)
    assert done.returncode == 0, done.stdout + done.stderr
    (ann,) = guests(tmp_path)
    assert ann["outcome"] == "served"
    assert ann["ordered"] == ann["served"] != ""
    check_disturbed(done, ann)
    for line in ("goal", "says", "understands", "sees", "knows", "(deliver_order"):
        assert f"robot   {line}" in done.stdout


def test_two_robots_share_a_disturbed_evening_by_one_plan(tmp_path: Path) -> None:
    two = ("robots:=robot_1,robot_2", "haste:=40", "seed:=5", "rtf:=5", "monitor:=false", "explain:=false")
    done = run(tmp_path, "guests:=1", "disturbances:=missing,chair", "wrong_share:=0", *two)
    assert done.returncode == 0, done.stdout + done.stderr
    (ann,) = guests(tmp_path)
    assert ann["outcome"] == "served" and ann["ordered"] == ann["served"] != ""
    check_disturbed(done, ann)
    assert (tmp_path / "results" / "timeline.png").read_bytes().startswith(b"\x89PNG")
    robots = guests(tmp_path, "robots.csv")
    assert [robot["robot"] for robot in robots] == ["robot_1", "robot_2"]
    assert all(float(robot["driven_m"]) > 1.0 and int(robot["actions"]) > 0 for robot in robots)
    # Which of them checks how many tables depends on when the guest's call interrupts that.
    assert any(int(robot["tables_checked"]) > 0 for robot in robots)
    # The guest has one waiter, and the other robot takes nothing that it hears for an answer.
    (waiter,) = {robot["robot"] for robot in robots if int(robot["delivered"])}
    served = re.findall(
        rf"\((?:take_order|order_to_barman|load_order|deliver_order) (\w+)(?: bar\w*)? {ann['table']}\)",
        done.stdout,
    )
    assert len(served) >= 4 and set(served) == {waiter}
    assert set(re.findall(r"(robot_\d) understands", done.stdout)) == {waiter}


@pytest.mark.long
def test_guests_who_are_not_understood_leave_or_walk_off_do_not_stop_the_evening(tmp_path: Path) -> None:
    done = run(tmp_path, "guests:=2", "disturbances:=unclear,leaves,walks_off", "wrong_share:=0", *SHORT)
    assert done.returncode == 0, done.stdout + done.stderr
    ann, ben = guests(tmp_path)
    assert (ann["outcome"], ann["served"]) == ("left before the order came", "")
    assert ben["outcome"] == "walked off before there was a table"
    assert done.stdout.count("Sorry, I did not understand. Good evening. What would you like?") >= 2
    goal = f"goal (already_served {ann['table']}), urgent: "
    ended = next(line for line in done.stdout.splitlines() if goal in line)
    assert f"the guests have left {ann['table']}" in ended, "the goal's end says why"
    assert f"(return_order {ann['table']})" in done.stdout
    assert "I am sorry, I have lost you." in done.stdout
    assert "no longer follows" in done.stdout
    assert "the books balance" in done.stdout


@pytest.mark.long
@pytest.mark.parametrize(("how", "moment"), [("host", "order"), ("all", "order"), ("all", "set_off")])
def test_a_robot_that_is_killed_with_an_order_on_its_tray_does_not_end_the_evening(
    tmp_path: Path, how: str, moment: str
) -> None:
    """Also not one that stands at the bar, where it keeps one of two counters."""
    short = ("guests:=3", "disturbances:=0", "wrong_share:=0", "haste:=8", "seed:=4", "rtf:=3")
    done = evening(how, moment, tmp_path, "monitor:=false", *short)
    log = (tmp_path / "evening.log").read_text()
    assert done["lost"] and done["exit_code"] == 0, log
    assert set(done["guests"].values()) == {"served"}, log
    assert "the books balance" in log
    assert "robot robot_2 is gone" in log


# The long ones start all nodes for a line that test_players_node.py finds in one of them.
@pytest.mark.parametrize(
    ("word", "text"),
    [
        pytest.param("guests:=12", "12 guests cannot be", marks=pytest.mark.long),
        pytest.param(
            "disturbances:=fire",
            "'fire' cannot be; disturbances are unclear, missing, chair",
            marks=pytest.mark.long,
        ),
        ("world_file:=/nowhere.yaml", "/nowhere.yaml"),
    ],
)
def test_bad_input_is_said(tmp_path: Path, word: str, text: str) -> None:
    done = run(tmp_path, word)
    assert done.returncode != 0
    assert text in done.stderr
    assert "Traceback" not in done.stderr

# SPDX-License-Identifier: Apache-2.0
"""A planner ends with everything it has started, within its limits, and a cancel never waits for it."""

import itertools
import os
import signal
import stat
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from merlin_ros.alarms import LONGEST_TICK, TickClock
from merlin_ros.processes.process_tree import descendants
from merlin_rosplan.planning.planner import PlannerSettings
from merlin_rosplan.planning.planning_outcome import PlannerState
from merlin_rosplan.supervision import planner_host
from merlin_rosplan.supervision.planner_host import HostError, PlannerHost, PlannerHosts
from merlin_rosplan.supervision.supervised_planning import Planning
from merlin_test import LONG
from merlin_test.process_signals import gone, hang

pytestmark = pytest.mark.processes

HOME = Path(__file__).parents[4] / "pddl" / "home"
# Leaves the group and the session of the planner, twice, and writes its number.
RUNAWAY = """
setsid sh -c 'echo $$ >> {pids}; setsid sh -c "echo \\$\\$ >> {pids}; sleep 600" & sleep 600' &
echo $$ >> {pids}
"""


@pytest.fixture
def planner(tmp_path):
    """Writes a planner; returns its command."""

    def write(body):
        path = tmp_path / "planner"
        path.write_text("#!/bin/sh\n" + body)
        path.chmod(path.stat().st_mode | stat.S_IXUSR)
        return f"{path} DOMAIN PROBLEM"

    return write


def planning(command, **settings):
    return Planning(
        PlannerSettings(command=command, **settings), str(HOME / "domain.pddl"), str(HOME / "problem.pddl")
    )


def test_the_begin_is_reported_while_the_planner_works(planner, tmp_path):
    reported = tmp_path / "reported"
    command = planner(f"while [ ! -e {reported} ]; do sleep 0.01; done; echo no plan")
    assert planning(command, time_limit=LONG).run(reported.touch).state != PlannerState.TIMEOUT
    assert reported.exists()


def test_a_node_whose_folder_was_removed_plans(planner, tmp_path, monkeypatch):
    gone_folder = tmp_path / "gone"
    gone_folder.mkdir()
    monkeypatch.chdir(gone_folder)
    gone_folder.rmdir()
    assert planning(planner("echo '0.0: (none) [1.0]'"), time_limit=LONG).run().state != PlannerState.CRASHED


def test_no_begin_is_reported_of_a_planner_that_cannot_be_started():
    reported = []
    wanted = planning("there-is-no-such-planner DOMAIN PROBLEM", fallback=False)
    assert wanted.run(lambda: reported.append("begun")).state == PlannerState.CRASHED
    assert reported == []


def three(pids):
    """The numbers of the planner and of its two runaways, once all are there."""
    end = time.monotonic() + LONG
    while time.monotonic() < end:
        found = pids.read_text().split() if pids.exists() else []
        if len(found) == 3:
            return [int(pid) for pid in found]
        time.sleep(0.005)
    raise AssertionError(f"only {found} have started")


def test_what_leaves_the_session_ends_with_the_time_limit(planner, tmp_path):
    pids = tmp_path / "pids"
    command = planner(RUNAWAY.format(pids=pids) + "sleep 600")
    for limit in (2.0, 8.0, 30.0, LONG):  # in which they have to begin, on a machine of any speed
        pids.unlink(missing_ok=True)
        outcome = planning(command, time_limit=limit).run()
        assert outcome.state == PlannerState.TIMEOUT
        if len(pids.read_text().split() if pids.exists() else []) == 3:
            break
    assert all(gone(pid) for pid in three(pids))


def test_what_leaves_the_session_ends_with_the_planner(planner, tmp_path):
    pids = tmp_path / "pids"
    body = RUNAWAY.format(pids=pids) + f"until [ $(wc -l < {pids}) = 3 ]; do sleep 0.01; done; exit 3"
    outcome = planning(planner(body)).run()
    assert outcome.state == PlannerState.CRASHED
    assert all(gone(pid) for pid in three(pids))


def test_what_leaves_the_session_ends_with_a_cancel(planner, tmp_path):
    pids = tmp_path / "pids"
    wanted = planning(planner(RUNAWAY.format(pids=pids) + "sleep 600"))
    outcomes = []
    thread = threading.Thread(target=lambda: outcomes.append(wanted.run()), daemon=True)
    thread.start()
    found = three(pids)
    wanted.cancel()
    thread.join(LONG)
    assert outcomes[0].state == PlannerState.CANCELLED
    # CANCELLED is reported when they have ended, not when they were killed.
    assert not any(Path(f"/proc/{pid}").exists() for pid in found)


def test_nothing_survives_the_death_of_the_node(planner, tmp_path):
    pids = tmp_path / "pids"
    command = planner(RUNAWAY.format(pids=pids) + "sleep 600")
    node = subprocess.Popen(
        [
            sys.executable,
            "-c",
            "import sys; from merlin_rosplan.planning.planner import PlannerSettings; "
            "from merlin_rosplan.supervision.supervised_planning import Planning; "
            "Planning(PlannerSettings(command=sys.argv[1]), sys.argv[2], sys.argv[3]).run()",
            command,
            str(HOME / "domain.pddl"),
            str(HOME / "problem.pddl"),
        ],
        env={**os.environ, "TMPDIR": str(tmp_path)},
    )
    found = three(pids)
    supervisor = int(Path(f"/proc/{found[0]}/stat").read_text().rsplit(")", 1)[1].split()[1])
    os.kill(node.pid, signal.SIGKILL)
    node.wait(LONG)
    assert all(gone(pid) for pid in [*found, supervisor])
    end = time.monotonic() + LONG
    while list(tmp_path.glob("planner-*")) and time.monotonic() < end:
        time.sleep(0.005)
    assert not list(tmp_path.glob("planner-*"))


def test_a_planner_that_needs_too_much_memory_is_ended_and_the_outcome_says_so(planner):
    hungry = "python3 -c 'b = bytearray(900000000)' || echo out of memory >&2; exit 1"
    outcome = planning(planner(hungry), memory_limit=400.0).run()
    assert outcome.state == PlannerState.CRASHED
    assert "memory" in outcome.reason and "400 MB" in outcome.reason


@pytest.mark.parametrize("duration", ["(= ?duration -6)", "(and (>= ?duration 5) (<= ?duration 1))"])
def test_an_action_that_can_never_last_as_its_domain_says_is_why_there_is_no_plan(tmp_path, duration):
    domain, problem = tmp_path / "domain.pddl", tmp_path / "problem.pddl"
    domain.write_text(
        f"""(define (domain d) (:requirements :durative-actions :duration-inequalities) (:predicates (spun))
        (:durative-action spin :parameters () :duration {duration} :effect (at end (spun))))"""
    )
    problem.write_text("(define (problem p) (:domain d) (:init) (:goal (spun)))")
    outcome = Planning(PlannerSettings(time_limit=LONG), str(domain), str(problem)).run()
    assert outcome.state == PlannerState.UNSOLVABLE
    assert (
        outcome.reason.startswith("(spun) cannot be reached, it needs (>= ") and "for spin" in outcome.reason
    )


def test_processes_that_need_too_much_memory_together_are_ended(planner, tmp_path):
    hungry = "import time; b = bytearray(180000000); time.sleep(600)"
    outcome = planning(planner(f'for i in 1 2 3; do python3 -c "{hungry}" & done; wait'), memory_limit=400.0)
    ended = outcome.run()
    assert ended.state == PlannerState.CRASHED and "~memory_limit" in ended.reason


@pytest.mark.parametrize(
    "body",
    [
        "exec yes",
        "trap '' XFSZ; yes; sleep 600",
        "yes >&2; sleep 600",
        "yes > sas_plan; sleep 600",
        "for i in 1 2 3 4 5 6; do head -c 900000 /dev/zero > part$i; done; sleep 600",
    ],
)
def test_a_planner_that_writes_without_end_is_ended_and_the_outcome_says_so(planner, tmp_path, body):
    outcome = planning(planner(f"pwd > {tmp_path}/folder\n{body}"), output_limit=1.0, time_limit=LONG).run()
    assert outcome.state == PlannerState.CRASHED
    assert "MB" in outcome.reason and "~output_limit" in outcome.reason
    folder = Path((tmp_path / "folder").read_text().strip())
    end = time.monotonic() + LONG  # it is removed behind the answer
    while folder.exists() and time.monotonic() < end:
        time.sleep(0.005)
    assert not folder.exists()


def opened_by_a_reader(fifo):
    """Opens a fifo for writing as soon as it is read."""
    end = time.monotonic() + LONG
    while True:
        try:
            return os.open(str(fifo), os.O_WRONLY | os.O_NONBLOCK)
        except OSError:
            assert time.monotonic() < end, "it is not read"
            time.sleep(0.002)


def test_a_cancel_does_not_wait_for_the_output_to_be_read(planner, tmp_path):
    reported = tmp_path / "reported"
    os.mkfifo(reported)
    # In the place of what it printed there is something that has no end.
    wanted = planning(planner(f"rm stdout.txt; mkfifo stdout.txt; pwd > {reported}"))
    outcomes = []
    thread = threading.Thread(target=lambda: outcomes.append(wanted.run()), daemon=True)
    thread.start()
    writer = opened_by_a_reader(Path(reported.read_text().strip()) / "stdout.txt")
    try:
        os.write(writer, b"0.000: (navigate anywhere kitchen)  [25.000]\n")
        wanted.cancel()
        thread.join(LONG)
    finally:
        os.close(writer)
    assert outcomes[0].state == PlannerState.CANCELLED


def test_reading_without_end_keeps_the_time_limit(planner, monkeypatch):
    monkeypatch.setattr("merlin_rosplan.supervision.supervised_planning.READING", 0.5)
    line = "0.000: (navigate anywhere kitchen)  [25.000]"
    outcome = planning(planner(f"yes '{line}' | head -c 60000000"), time_limit=2.0).run()
    assert outcome.state == PlannerState.TIMEOUT and outcome.seconds < LONG


def test_a_killed_supervisor_costs_one_planning(planner, tmp_path):
    hosts = PlannerHosts()
    host = hosts.take()
    hosts.give_back(host)
    fifo = tmp_path / "running"
    os.mkfifo(fifo)
    settings = PlannerSettings(command=planner(f"echo $$ > {fifo}; sleep 600"), time_limit=2 * LONG)
    paths = str(HOME / "domain.pddl"), str(HOME / "problem.pddl")
    outcomes = []
    wanted = Planning(settings, *paths, hosts=hosts)
    thread = threading.Thread(target=lambda: outcomes.append(wanted.run()), daemon=True)
    thread.start()
    running = int(fifo.read_text())
    os.kill(host.pid, signal.SIGKILL)
    thread.join(LONG)
    assert gone(running)
    assert outcomes[0].state == PlannerState.CRASHED and "supervising process" in outcomes[0].reason
    settings = PlannerSettings(command=planner("echo ';; Problem unsolvable!'"))
    assert Planning(settings, *paths, hosts=hosts).run().state == PlannerState.UNSOLVABLE
    hosts.take().close()


def processes_of(plannings, pids):
    """The processes that have done some plannings, one right behind the other."""
    for each in plannings:
        assert each.run().state == PlannerState.NO_PLAN
    return pids.read_text().split()[-len(plannings) :]


def test_a_planning_does_not_wait_for_a_new_process_where_nothing_of_the_last_one_is_left(tmp_path):
    pids = tmp_path / "pids"
    command = f"echo $PPID >> {pids}; echo No plan found in 8 happenings"
    assert len(set(processes_of([planning(command) for _ in range(3)], pids))) == 1
    other = [planning(command, memory_limit=2000.0), planning(command, memory_limit=3000.0)]
    assert len(set(processes_of(other, pids))) == 2  # a limit cannot be raised again


def test_nothing_of_a_planning_is_left_to_the_next_one(tmp_path):
    pids, left = tmp_path / "pids", tmp_path / "left"
    command = (
        f"echo $PPID >> {pids}; setsid sleep 600 & echo $! >> {left}; echo No plan found in 8 happenings"
    )
    assert len(set(processes_of([planning(command), planning(command)], pids))) == 2
    assert gone(int(left.read_text().split()[0]))


def test_the_child_that_waits_ends_with_its_killed_supervisor(tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    host = PlannerHost()
    end = time.monotonic() + LONG
    while not descendants(host.pid) and time.monotonic() < end:
        time.sleep(0.005)
    while not list(tmp_path.glob("planner-*")) and time.monotonic() < end:
        time.sleep(0.005)
    (folder,) = tmp_path.glob("planner-*")
    os.kill(host.pid, signal.SIGKILL)
    while folder.exists() and time.monotonic() < end:
        time.sleep(0.005)
    assert not folder.exists()
    host.close()


def test_a_supervisor_that_hangs_ends_the_wait_for_its_answer():
    host = PlannerHost()
    hang(host.pid)
    try:
        host.begin({"time_limit": 0.0})
        with pytest.raises(HostError, match=f"process {host.pid} does not answer: it hangs"):
            host.wait(0.1)
        assert not host.alive
    finally:
        os.kill(host.pid, signal.SIGKILL)
        host.close()


def test_a_stall_of_the_node_does_not_use_up_the_wait_for_an_answer(monkeypatch):
    looks = itertools.count(0.0, 10.0)  # the node is stalled for 10 s before each look at the clock
    monkeypatch.setattr(planner_host, "TickClock", lambda: TickClock(lambda: next(looks)))
    host = PlannerHost()
    hang(host.pid)
    try:
        host.begin({"time_limit": 0.0})
        with pytest.raises(HostError, match="it hangs"):
            host.wait(5 * LONGEST_TICK)
        assert next(looks) > 5 * 10.0
    finally:
        os.kill(host.pid, signal.SIGKILL)
        host.close()


def test_a_planner_may_be_ended_by_a_signal_that_the_supervisor_leaves_alone(planner):
    outcome = planning(planner("kill -TERM $$; sleep 600"), time_limit=LONG).run()
    assert outcome.state == PlannerState.CRASHED and "SIGTERM" in outcome.reason


@pytest.mark.parametrize("tuned, seen", [("1", ""), ("", "glibc.malloc.arena_max=1")])
def test_a_search_is_not_slowed_by_what_saves_the_nodes_memory(planner, tmp_path, monkeypatch, tuned, seen):
    monkeypatch.setenv("GLIBC_TUNABLES", "glibc.malloc.arena_max=1")
    monkeypatch.setenv("RESPAWN_TUNED", tuned)
    command = planner(f'echo "$GLIBC_TUNABLES" > {tmp_path}/seen; echo ";; Problem unsolvable!"')
    paths = str(HOME / "domain.pddl"), str(HOME / "problem.pddl")
    hosts = PlannerHosts()
    Planning(PlannerSettings(command=command), *paths, hosts=hosts).run()
    hosts.take().close()
    assert (tmp_path / "seen").read_text().strip() == seen

# SPDX-License-Identifier: Apache-2.0
"""What `rosrun merlin send` says while a goal waits and runs."""

import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import List

import pytest
import rospy
from merlin_msgs.msg import ExecuteFeedback, ExecutorStatus, GuardStatus, QueuedGoal, RunningAction

from merlin import send
from merlin.send_progress import SendProgress
from merlin_test import LONG

RUNNING, IDLE = ExecutorStatus.RUNNING, ExecutorStatus.IDLE
OTHER = ExecutorStatus(state=RUNNING, request="other", goals=["(checked hall)"])
MINE = ExecutorStatus(state=RUNNING, request="mine", goals=["(checked kitchen)"])


@pytest.fixture()
def said() -> List[str]:
    return []


@pytest.fixture()
def progress(said: List[str], monkeypatch: pytest.MonkeyPatch) -> SendProgress:
    monkeypatch.setattr("rospy.Subscriber", lambda *_, **__: None)
    made = SendProgress(lambda line: said.append(line.strip()))
    made.follow("", SimpleNamespace(id="mine", done=False))  # type: ignore[arg-type]
    return made


def test_each_change_is_said_once(progress: SendProgress, said: List[str]) -> None:
    for _ in range(2):
        progress.feedback(ExecuteFeedback(stage="PLAN"))
        progress.executor(MINE)
    progress.feedback(ExecuteFeedback(running=[RunningAction(name="navigate")]))
    progress.feedback(ExecuteFeedback(stage="DISPATCH_PLAN"))
    assert said == ["planning", "(navigate)"]


def test_what_runs_before_it_is_named(progress: SendProgress, said: List[str]) -> None:
    progress.executor(OTHER)
    progress.executor(MINE)
    assert said == ["waits: (checked hall) runs"]


def test_what_runs_in_the_same_plan_is_named_once(progress: SendProgress, said: List[str]) -> None:
    shared = ExecutorStatus(state=RUNNING, request="other", goals=["(checked hall)"])
    shared.together = [QueuedGoal(request="mine", goals=["(checked kitchen)"])]
    for status in (shared, shared, MINE):
        progress.executor(status)
    assert said == ["in one plan with (checked hall)"]


def test_a_request_that_waits_and_can_no_longer_be_on_time_says_why(
    progress: SendProgress, said: List[str]
) -> None:
    progress.executor(OTHER)
    progress.feedback(ExecuteFeedback(reason="(checked hall) is expected to run until 195.0 s"))
    assert said == ["waits: (checked hall) runs", "(checked hall) is expected to run until 195.0 s"]


def test_a_request_that_may_not_begin_yet_says_until_when(
    progress: SendProgress, said: List[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rospy.Time.now", lambda: rospy.Time(100))
    progress.follow("", SimpleNamespace(id="mine", done=False), rospy.Time(160))  # type: ignore[arg-type]
    progress.executor(ExecutorStatus(state=IDLE))
    progress.executor(OTHER)
    monkeypatch.setattr("rospy.Time.now", lambda: rospy.Time(160))
    progress.executor(OTHER)
    assert said == ["waits until 160.0 s", "waits: (checked hall) runs"]


def test_a_failure_is_said_once_and_a_second_one_again(progress: SendProgress, said: List[str]) -> None:
    runs = [RunningAction(name="drive")]
    for stage, running, reason in (
        ("DISPATCH_PLAN", runs, ""),
        ("REPLAN", [], "(drive) failed: blocked"),
        ("PLAN", [], "(drive) failed: blocked"),
        ("DISPATCH_PLAN", [], "(drive) failed: blocked"),
        ("DISPATCH_PLAN", runs, "(drive) failed: blocked"),
        ("DISPATCH_PLAN", [], "(drive) failed: blocked"),
        ("REPLAN", [], "(drive) failed: blocked"),  # of the plan before, until the new reason comes
        ("REPLAN", [], "(drive) failed: lost"),
    ):
        progress.feedback(ExecuteFeedback(stage=stage, running=running, reason=reason))
    assert said == ["(drive)", "(drive) failed: blocked", "(drive)", "(drive) failed: lost"]


def test_a_paused_executor_is_named(progress: SendProgress, said: List[str]) -> None:
    progress.executor(ExecutorStatus(state=IDLE, paused=True))
    assert len(said) == 1 and "the Executor is paused" in said[0] and "merlin/resume" in said[0]


def test_a_base_that_is_held_is_named(progress: SendProgress, said: List[str]) -> None:
    progress.executor(MINE)
    progress.guard(GuardStatus(state=GuardStatus.STOPPED, reason="stopped by Ana"))
    assert len(said) == 1 and "the base is held by Ana since " in said[0] and "merlin/release" in said[0]


def test_a_robot_of_several_that_is_held_is_named(progress: SendProgress, said: List[str]) -> None:
    progress.executor(ExecutorStatus(state=IDLE, waits="robot tom is held by Ana since 14:03:07"))
    assert said == [
        "robot tom is held by Ana since 14:03:07; `merlin/release` of that robot lets it move again"
    ]


def test_a_drive_that_goes_wrong_is_named_while_its_request_runs(
    progress: SendProgress, said: List[str]
) -> None:
    stuck = GuardStatus(state=GuardStatus.PASSING, warning="/move_base drives, and the base does not move")
    progress.executor(OTHER)
    progress.guard(stuck)
    progress.executor(MINE)
    assert said == ["waits: (checked hall) runs", stuck.warning]


def test_a_breakpoint_is_named(progress: SendProgress, said: List[str]) -> None:
    progress.executor(ExecutorStatus(state=RUNNING, request="mine", held="(ask kitchen)"))
    assert said == ["held at the breakpoint (ask kitchen)"]


# Runs a script until it imports what it does, and holds it there.
HELD = """
import runpy, sys
from merlin_test import LONG
class Hold:
    def find_spec(name, *_):
        if name == "merlin.send":
            print("imports", flush=True)
            sys.stdin.readline()
sys.meta_path.insert(0, Hold)
del sys.argv[0]
runpy.run_path(sys.argv[0], run_name="__main__")
"""


@pytest.mark.everywhere
def test_ctrl_c_before_the_node_has_begun_gives_no_traceback() -> None:
    script = Path(__file__).resolve().parents[3] / "src" / "merlin" / "scripts" / "send"
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    process = subprocess.Popen([sys.executable, "-c", HELD, script, "(checked hall)"], **pipes)
    assert process.stdout is not None and process.stdout.readline() == "imports\n"
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=LONG)
    assert process.returncode == -signal.SIGINT and errors == ""


@pytest.mark.parametrize("timeout", ["nan", "0", "-3", "soon"])
def test_a_timeout_that_is_not_a_time_is_refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, timeout: str
) -> None:
    monkeypatch.setattr(sys, "argv", ["send", "(checked hall)", f"--timeout={timeout}"])
    with pytest.raises(SystemExit) as caught:
        send.main()
    assert caught.value.code == 2
    assert f"--timeout: {timeout} is not a number of seconds above 0" in capsys.readouterr().err


def test_a_request_is_followed_or_cancelled(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["send", "--follow", "one-lasting", "--cancel", "other-lasting"])
    with pytest.raises(SystemExit) as ended:
        send.main()
    assert ended.value.code == 2 and "not allowed with argument" in capsys.readouterr().err

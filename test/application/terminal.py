# SPDX-License-Identifier: Apache-2.0
"""A new shell, as a reader of the documents opens it."""

import contextlib
import fcntl
import os
import signal
import subprocess
from pathlib import Path

from merlin_test.failure_texts import ends_of_logs

ROOT = Path(__file__).resolve().parents[2]
LIMIT = 900.0  # s for all commands together, on a machine that does much else
ENDS = 20.0  # s from Ctrl-C to the end of what it ends


def run_in_shell(commands: str, ros_folder: Path, folder: Path) -> str:
    """Runs commands up to the first that fails, which fails the test; returns what they print.

    :param ros_folder: of ROS's own files and logs.
    :param folder: in which the shell begins.
    """
    env = {key: os.environ[key] for key in ("PATH", "HOME")}
    env.update(ROS_HOME=str(ros_folder / "ros"), ROS_LOG_DIR=str(ros_folder / "log"))
    screen = ros_folder / "screen.txt"
    with screen.open("w", encoding="utf-8") as output:
        shell = subprocess.Popen(
            ["bash", "-e", "-c", commands],
            env=env,
            cwd=str(folder),
            stdout=output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        try:
            ended = f"exit code {shell.wait(LIMIT)}"
        except subprocess.TimeoutExpired:
            ended = f"no end within {LIMIT} s\n{running(shell.pid)}"
        finally:
            stop(shell)
    said = screen.read_text(encoding="utf-8", errors="replace")
    assert ended == "exit code 0", f"{ended}:\n{said[-6000:]}\n" + "\n".join(ends_of_logs(ros_folder / "log"))
    return said


def make_install() -> None:
    """Fills the install space, once in a run of tests; two at once would write the same files."""
    # Not "install": `make build` has built all, and this would look at each message again.
    command = ["make", "-C", str(ROOT / "build"), "install/fast"]
    run = os.environ.get("PYTEST_XDIST_TESTRUNUID", str(os.getpid()))
    with (ROOT / "build" / ".installing").open("a+") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        lock.seek(0)
        if lock.read() == run:
            return
        made = subprocess.run(command, capture_output=True, text=True, timeout=1300, check=False)
        assert made.returncode == 0, (made.stdout + made.stderr)[-3000:]
        lock.truncate(0)
        lock.write(run)


def running(session: int) -> str:
    """The processes of a session, with how long they have run and where they wait."""
    command = ["ps", "-s", str(session), "-o", "pid,ppid,etimes,stat,wchan:20,args"]
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout


def stop(shell: "subprocess.Popen[bytes]") -> None:
    """Ends a shell that still runs, and what it has started."""
    if shell.poll() is None:
        os.killpg(shell.pid, signal.SIGINT)
        with contextlib.suppress(subprocess.TimeoutExpired):
            shell.wait(ENDS)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(shell.pid, signal.SIGKILL)
    shell.wait()

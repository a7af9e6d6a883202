"""A new shell, as a reader of the documents opens it."""

import os
import signal
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
LIMIT = 450.0  # s for all commands together


def run_in_shell(commands: str, ros_folder: Path, folder: Path) -> str:
    """Runs commands up to the first that fails, which fails the test; returns what they print.

    :param ros_folder: of ROS's own files and logs.
    :param folder: in which the shell begins.
    """
    env = {key: os.environ[key] for key in ("PATH", "HOME")}
    env.update(ROS_HOME=str(ros_folder / "ros"), ROS_LOG_DIR=str(ros_folder / "log"), PYTHONUNBUFFERED="1")
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
            ended = f"no end within {LIMIT} s"
        finally:
            stop(shell)
    said = screen.read_text(encoding="utf-8", errors="replace")
    assert ended == "exit code 0", f"{ended}:\n{said[-6000:]}"
    return said


def stop(shell: "subprocess.Popen[bytes]") -> None:
    """Ends a shell that still runs, and what it has started."""
    for how in (signal.SIGINT, signal.SIGKILL):
        if shell.poll() is None:
            os.killpg(shell.pid, how)
            try:
                shell.wait(20.0)
            except subprocess.TimeoutExpired:
                continue

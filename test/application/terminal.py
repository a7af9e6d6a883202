"""A new shell, as a reader of the documents opens it."""

import os
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
    done = subprocess.run(
        ["bash", "-e", "-c", commands],
        env=env,
        cwd=str(folder),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=LIMIT,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-6000:]
    return done.stdout

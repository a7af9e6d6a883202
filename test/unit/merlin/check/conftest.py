# SPDX-License-Identifier: Apache-2.0
"""What `rosrun merlin check` says, many times in one process: each process of its own takes seconds."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Callable, Iterator, NamedTuple

import pytest


class Answer(NamedTuple):
    returncode: int
    stdout: str
    stderr: str


@pytest.fixture(scope="session")
def check() -> Iterator[Callable[..., Answer]]:
    """Checks an application: a folder of Python modules, and the words of the command."""
    command = [sys.executable, str(Path(__file__).with_name("check_many.py"))]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:

        def ask(folder: Path, *words: str) -> Answer:
            process.stdin.write(json.dumps([str(folder), words]) + "\n")
            process.stdin.flush()
            return Answer(*json.loads(process.stdout.readline()))

        yield ask
        process.stdin.close()
        assert process.wait(60) == 0

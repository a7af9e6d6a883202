# SPDX-License-Identifier: Apache-2.0
"""What `rosrun merlin check` says, many times in one process: each process of its own takes seconds."""

import json
import subprocess
import sys
import tempfile
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
    pipe = subprocess.PIPE
    with tempfile.TemporaryFile("w+") as said, subprocess.Popen(
        command, stdin=pipe, stdout=pipe, stderr=said, text=True
    ) as process:

        def ask(folder: Path, *words: str) -> Answer:
            process.stdin.write(json.dumps([str(folder), words]) + "\n")
            process.stdin.flush()
            return Answer(*json.loads(process.stdout.readline()))

        yield ask
        process.stdin.write("\n")
        process.stdin.close()
        try:
            code = process.wait(60)
        finally:
            process.kill()  # or the suite would wait for it
        said.seek(0)
        assert code == 0, said.read()  # with where it hung, when it was ended by force

# SPDX-License-Identifier: Apache-2.0
"""A process's clock on the wall can be set, and its monotonic clock goes on."""

import os
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path
from typing import Iterator, List

import pytest
from chaos.under_test.wall_clock import WallClocks, why_not_set

#: s that an answer may take, far below the steps.
NEAR = 20.0
CLOCKS = """
import sys, time
for line in sys.stdin:
    time.sleep(0.00001)
    print(time.time(), time.monotonic(), flush=True)
"""


@pytest.mark.skipif(bool(why_not_set()), reason=why_not_set())
def test_only_the_named_clock_is_set_and_the_monotonic_one_goes_on(tmp_path: Path) -> None:
    clocks = WallClocks(tmp_path)
    clocks.build()
    with started(clocks, "one") as one, started(clocks, "other") as other:
        for off in (-30.0, -86400.0):
            clocks.set("one", off)
            before = time.monotonic()
            wall, monotonic = look(one)
            assert before <= monotonic <= time.monotonic()
            assert wall - time.time() == pytest.approx(off, abs=NEAR)
            assert look(other)[0] - time.time() == pytest.approx(0.0, abs=NEAR)
        clocks.set("all", -86400.0)
        assert look(other)[0] - time.time() == pytest.approx(-86400.0, abs=NEAR)


@contextmanager
def started(clocks: WallClocks, name: str) -> "Iterator[subprocess.Popen[str]]":
    env = {**os.environ, **clocks.environment(name)}
    command, pipe = [sys.executable, "-c", CLOCKS], subprocess.PIPE
    with subprocess.Popen(command, env=env, text=True, stdin=pipe, stdout=pipe) as process:
        yield process
        process.kill()


def look(process: "subprocess.Popen[str]") -> List[float]:
    assert process.stdin is not None and process.stdout is not None
    process.stdin.write("\n")
    process.stdin.flush()
    return [float(word) for word in process.stdout.readline().split()]

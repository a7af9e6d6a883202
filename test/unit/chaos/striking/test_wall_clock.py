"""A process's clock on the wall can be set, and its monotonic clock goes on."""

import os
import subprocess
import sys
import time
from pathlib import Path
from typing import List

import pytest
from chaos.under_test.wall_clock import WallClocks, why_not_set

CLOCKS = """
import sys, time
for line in sys.stdin:
    print(time.time(), time.monotonic(), flush=True)
"""


def test_only_the_named_clock_is_set(tmp_path: Path) -> None:
    clocks = WallClocks(tmp_path / "clocks")
    for name in ("one", "other"):
        (tmp_path / "clocks" / name).write_text("+0\n")
    clocks.set("one", -30.0)
    assert [(tmp_path / "clocks" / name).read_text() for name in ("one", "other")] == ["-30\n", "+0\n"]
    clocks.set("all", -86400.0)
    assert [(tmp_path / "clocks" / name).read_text() for name in ("one", "other")] == ["-86400\n"] * 2


@pytest.mark.skipif(bool(why_not_set()), reason=why_not_set())
def test_a_process_sees_another_time_and_its_monotonic_clock_goes_on(tmp_path: Path) -> None:
    clocks = WallClocks(tmp_path / "clocks")
    env = {**os.environ, **clocks.environment("one")}
    command = [sys.executable, "-c", CLOCKS]
    with subprocess.Popen(
        command, env=env, text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        assert process.stdin is not None and process.stdout is not None

        def look() -> List[float]:
            process.stdin.write("\n")
            process.stdin.flush()
            return [float(word) for word in process.stdout.readline().split()]

        wall, _ = look()
        assert abs(wall - time.time()) < 20.0
        clocks.set("one", -86400.0)
        while look()[0] > time.time() - 86400.0 + 20.0:
            pass  # it looks at the file once per second; a test's own limit ends what hangs
        before = time.monotonic()
        assert before <= look()[1] <= time.monotonic()
        process.kill()

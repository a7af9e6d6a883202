# SPDX-License-Identifier: Apache-2.0
"""What `make debian` runs in a bare root."""

import subprocess
from pathlib import Path
from typing import List

import pytest

WORKSPACE = Path(__file__).parents[3]


@pytest.mark.parametrize(
    ("given", "run"), [([], 'PYTEST=""'), (["PYTEST=test/unit/smach -x"], 'PYTEST="test/unit/smach -x"')]
)
def test_all_tests_run_unless_some_are_named(given: List[str], run: str) -> None:
    command = ["make", "-n", "debian", "TARGET=test", *given]
    shown = subprocess.run(command, cwd=WORKSPACE, stdout=subprocess.PIPE, check=True).stdout.decode()
    assert run in shown

# SPDX-License-Identifier: Apache-2.0
"""A port that one process of tests was given is given to no other one before it is released."""

import subprocess
import sys

from merlin_test.ports import free_ports, release

#: Gets one of the given ports, again and again: which one is random.
OTHER = """
import sys
from merlin_test import ports
ports.RANGE = tuple(map(int, sys.argv[1:]))
for _ in range(20):
    found = ports.free_ports(1)
    print(*found)
    ports.release(found)
"""


def test_no_process_gets_the_port_of_another_one() -> None:
    taken, given_back = free_ports(2)
    release([given_back])
    try:
        command = [sys.executable, "-c", OTHER, str(taken), str(given_back)]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
    finally:
        release([taken])
    assert set(done.stdout.split()) == {str(given_back)}

# SPDX-License-Identifier: Apache-2.0
"""Clocks of the robots that are apart, and run at different rates."""

import os
import subprocess
import time
from pathlib import Path
from typing import Dict, NamedTuple

SOURCE = Path(__file__).with_name("clocks.c")


class Clock(NamedTuple):
    """How a robot's clock differs from the hub's."""

    offset: float
    """s that its date is ahead."""
    rate: float
    """How fast it runs; the fleet states a drift of 1 %."""


#: Of ann and bob: 4 s apart, and as far from the hub's rate as is stated.
APART = {"ann": Clock(2.0, 0.99), "bob": Clock(-2.0, 1.01)}


class Clocks:
    """Builds what gives the processes of a robot its clock.

    :param clocks: of robots; others keep the machine's.
    :param folder: takes the library.
    :raises OSError: when it is not possible to build it.
    """

    def __init__(self, clocks: Dict[str, Clock], folder: Path) -> None:
        self._clocks = clocks
        self._library = folder.resolve() / "clocks.so"
        self._origin = time.monotonic()
        if clocks:
            words = ["cc", "-O2", "-Wall", "-Werror", "-shared", "-fPIC", str(SOURCE), "-ldl"]
            done = subprocess.run(
                [*words, "-o", str(self._library)], capture_output=True, text=True, check=False
            )
            if done.returncode:
                raise OSError(f"{SOURCE} cannot be built: {done.stderr.strip()}")

    def environment(self, robot: str) -> Dict[str, str]:
        """Variables of the robot's processes."""
        if robot not in self._clocks:
            return {}
        clock = self._clocks[robot]
        preloaded = [str(self._library), *os.environ.get("LD_PRELOAD", "").split()]
        return {
            "LD_PRELOAD": " ".join(preloaded),
            "MERLIN_CLOCK": f"{clock.offset} {clock.rate} {self._origin:.9f}",
        }

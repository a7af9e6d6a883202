# SPDX-License-Identifier: Apache-2.0
"""A clock on the wall that can be set for single processes, by a library that is preloaded into them.

libfaketime does not help: where it leaves the monotonic clock alone, Python's sleep fails (0.9.10: EINVAL).
"""

import shutil
import struct
import subprocess
import tempfile
from functools import lru_cache
from pathlib import Path
from typing import Dict

SOURCE = Path(__file__).with_name("wall_clock.c")
COMPILER = "cc"
_SECONDS = struct.Struct("q")


@lru_cache(maxsize=None)
def why_not_set() -> str:
    """Why the clock on the wall cannot be set; empty when it can."""
    if shutil.which(COMPILER) is None:
        return "setting the clock on the wall needs a C compiler: apt-get install gcc libc6-dev"
    with tempfile.TemporaryDirectory() as folder:
        try:
            WallClocks(Path(folder)).build()
        except RuntimeError as error:
            return f"setting the clock on the wall needs a C compiler: {error}"
    return ""


class WallClocks:
    """The clocks of a system's processes.

    :param folder: takes a file per process, and the library.
    """

    def __init__(self, folder: Path) -> None:
        self._library, self._clocks = folder / "wall_clock.so", folder / "clocks"

    def build(self) -> None:
        """Makes the library; once, before any process is started.

        :raises RuntimeError: the compiler fails.
        """
        self._clocks.mkdir(parents=True, exist_ok=True)
        command = [COMPILER, "-shared", "-fPIC", "-o", str(self._library), str(SOURCE), "-ldl"]
        made = subprocess.run(command, capture_output=True, text=True, check=False)
        if made.returncode:
            raise RuntimeError(f"{COMPILER} {SOURCE.name}: {made.stderr.strip()[:300]}")

    def environment(self, process: str) -> Dict[str, str]:
        """Variables that give a process a clock of its own, which is right at first.

        :param process: its name.
        """
        file = self._clocks / process
        file.write_bytes(_SECONDS.pack(0))
        return {"LD_PRELOAD": str(self._library), "CHAOS_WALL_CLOCK": str(file)}

    def set(self, process: str, off: float) -> None:
        """Sets a clock; the process sees it at once.

        :param process: its name; "all": every one.
        :param off: whole seconds from the right time.
        """
        files = sorted(self._clocks.iterdir()) if process == "all" else [self._clocks / process]
        for file in files:
            with file.open("r+b") as clock:  # in place: the process has mapped it
                clock.write(_SECONDS.pack(int(off)))

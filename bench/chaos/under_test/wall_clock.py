"""A clock on the wall that can be set for single processes, by libfaketime where it is installed.

The library reads from a file by how much the clock is off. The monotonic clock is left as it is.
"""

import platform
from pathlib import Path
from typing import Dict, Optional

#: Where Debian has the library for programs with threads.
LIBRARIES = "/usr/lib/{machine}-linux-gnu/faketime/libfaketimeMT.so.1"
#: s after which a process looks at its file again.
LOOK = 1


def library() -> Optional[Path]:
    """The library; None when it is not installed."""
    path = Path(LIBRARIES.format(machine=platform.machine()))
    return path if path.exists() else None


def why_not_set() -> str:
    """Why the clock on the wall cannot be set; empty when it can."""
    return "" if library() else "the clock on the wall needs libfaketime: apt-get install faketime"


class WallClocks:
    """The clocks of a system's processes.

    :param folder: takes a file per process.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        folder.mkdir(exist_ok=True)

    def environment(self, process: str) -> Dict[str, str]:
        """Variables that give a process a clock of its own, which is right at first.

        :param process: its name.
        """
        found = library()
        assert found is not None, why_not_set()
        file = self._folder / process
        file.write_text("+0\n")
        return {
            "LD_PRELOAD": str(found),
            "FAKETIME_TIMESTAMP_FILE": str(file),
            "FAKETIME_CACHE_DURATION": str(LOOK),
            "FAKETIME_DONT_FAKE_MONOTONIC": "1",
            "DONT_FAKE_MONOTONIC": "1",
        }

    def set(self, process: str, off: float) -> None:
        """Sets a clock.

        :param process: its name; "all": every one.
        :param off: s from the right time.
        """
        files = sorted(self._folder.iterdir()) if process == "all" else [self._folder / process]
        for file in files:
            file.write_text(f"{off:+.0f}\n")

# SPDX-License-Identifier: Apache-2.0
"""A small disk of its own, which can be made full."""

import contextlib
import subprocess
from pathlib import Path


class SmallDisk:
    """Mounts one in memory.

    :param path: folder that it becomes.
    :raises OSError: when that is not possible.
    """

    def __init__(self, path: Path, size_mb: int) -> None:
        self.path = path
        path.mkdir(parents=True)
        words = ["mount", "-t", "tmpfs", "-o", f"size={size_mb}m", "tmpfs", str(path)]
        done = subprocess.run(words, capture_output=True, text=True, check=False)
        if done.returncode:
            raise OSError(f"no small disk: {done.stderr.strip()}")

    def fill(self) -> None:
        """Leaves no room on it."""
        with contextlib.suppress(OSError), (self.path / "filler").open("ab", buffering=0) as filler:
            for size in (1 << 20, 1 << 12, 1):
                with contextlib.suppress(OSError):
                    while filler.write(b"\0" * size):
                        continue

    def free(self) -> None:
        """Gives the room back."""
        (self.path / "filler").unlink(missing_ok=True)

    def close(self) -> None:
        """Takes it away."""
        subprocess.run(["umount", "-l", str(self.path)], capture_output=True, check=False)

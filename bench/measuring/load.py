# SPDX-License-Identifier: Apache-2.0
"""A load on the processors beside which something is measured or tested."""

import contextlib
import subprocess
import sys
from typing import Iterator

_ENDLESS = "import os\nparent = os.getppid()\nwhile os.getppid() == parent:\n    sum(range(100000))"


@contextlib.contextmanager
def load(processes: int) -> Iterator[None]:
    """Keeps processors busy with so many processes; they end with this one, however it ends."""
    busy = [subprocess.Popen([sys.executable, "-c", _ENDLESS]) for _ in range(processes)]
    try:
        yield
    finally:
        for each in busy:
            each.kill()
            each.wait()

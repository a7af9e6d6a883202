"""Keeps what a C++ library prints away from the terminal."""

import contextlib
import ctypes
import os
import sys
from typing import Iterator


@contextlib.contextmanager
def silence() -> Iterator[None]:
    """Sends standard output (the descriptor, not only Python's) to nowhere meanwhile."""
    sys.stdout.flush()
    kept = os.dup(1)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        yield
    finally:
        ctypes.CDLL(None).fflush(None)  # what C's own buffer still holds belongs to the silence
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)

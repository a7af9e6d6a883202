# SPDX-License-Identifier: Apache-2.0
"""Keeps what a C++ library prints away from the terminal."""

import contextlib
import ctypes
import os
import sys
from typing import Iterator


@contextlib.contextmanager
def muted_output() -> Iterator[None]:
    """Sends the descriptors of standard output and error to nowhere meanwhile; exceptions pass."""
    sys.stdout.flush()
    sys.stderr.flush()
    nowhere = os.open(os.devnull, os.O_WRONLY)
    kept = [(stream, os.dup(stream)) for stream in (1, 2)]
    try:
        for stream, _ in kept:
            os.dup2(nowhere, stream)
        yield
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        ctypes.CDLL(None).fflush(None)  # what C's own buffer still holds belongs to the silence
        for stream, copy in kept:
            os.dup2(copy, stream)
            os.close(copy)
        os.close(nowhere)

# SPDX-License-Identifier: Apache-2.0
"""The pictures that the state names by their versions: those of now, which the history keeps too."""

import hashlib
import struct
import threading
import zlib
from typing import Any, Callable, Dict, Optional, Tuple


class Pictures:
    """The newest picture of each name, as PNG. Safe between threads.

    :param keep: takes name, version and data of each new picture, before the state names it.
    """

    def __init__(self, keep: Optional[Callable[[str, str, bytes], object]] = None) -> None:
        self._keep = keep
        self._lock = threading.Lock()  # guards the newest ones
        self._newest: Dict[str, Tuple[str, bytes]] = {}

    def put(self, name: str, data: bytes) -> str:
        """Takes a picture; returns its version, which the same picture has in each run."""
        version = hashlib.sha256(data).hexdigest()[:16]
        if self._keep is not None:
            self._keep(name, version, data)
        with self._lock:
            self._newest[name] = version, data
        return version

    def get(self, name: str, version: str = "") -> Optional[bytes]:
        """The newest picture, or None; with a version, only if it is that one."""
        with self._lock:
            newest, data = self._newest.get(name, ("", None))
        return data if version in ("", newest) else None


_COLOUR_TYPES = {1: 0, 2: 4, 3: 2, 4: 6}  # channels → PNG's number


def png(pixels: Any) -> bytes:
    """A picture: grey, grey with opacity, RGB or RGBA.

    :param pixels: rows from the top, columns and channels, as an array of bytes.
    """
    height, width, channels = pixels.shape
    header = struct.pack(">IIBBBBB", width, height, 8, _COLOUR_TYPES[channels], 0, 0, 0)
    # Each row begins with its filter: none.
    rows = b"".join(b"\0" + row.tobytes() for row in pixels)
    parts: Tuple[Tuple[bytes, bytes], ...] = (
        (b"IHDR", header),
        (b"IDAT", zlib.compress(rows, 6)),
        (b"IEND", b""),
    )
    return b"\x89PNG\r\n\x1a\n" + b"".join(_chunk(kind, body) for kind, body in parts)


def _chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

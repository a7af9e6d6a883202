# SPDX-License-Identifier: Apache-2.0
"""Pictures as PNG."""

import struct
import zlib
from typing import Any, Tuple

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

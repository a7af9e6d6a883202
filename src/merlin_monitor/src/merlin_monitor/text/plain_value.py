# SPDX-License-Identifier: Apache-2.0
"""Values as a page can take them: whatever arrives over ROS becomes JSON of bounded size."""

import math
from typing import Any

LONGEST_TEXT = 8000  # characters
LONGEST_KEY = 2000  # characters
CUT = "…"


def plain_text(value: Any, limit: int = LONGEST_TEXT) -> str:
    """A text of bounded length, made of anything; it can be encoded: halves of letters become ``?``."""
    if isinstance(value, bytes):
        value = value.decode("utf-8", "replace")
    text = value if isinstance(value, str) else str(value)
    text = text if len(text) <= limit else text[:limit] + CUT
    return text.encode("utf-8", "replace").decode()


def plain(value: Any) -> Any:
    """A value as JSON knows it: numbers that JSON has no word for become None, other objects text."""
    if value is None or isinstance(value, (bool, int)):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {plain_text(key, LONGEST_KEY): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    return plain_text(value)

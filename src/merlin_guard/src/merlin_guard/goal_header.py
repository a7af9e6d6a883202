# SPDX-License-Identifier: Apache-2.0
"""Reads the id of an action's goal message without knowing the action's type."""

import struct
from typing import Tuple


def read_goal_header(message: bytes) -> Tuple[str, int]:
    """The id and stamp of a serialized ``...ActionGoal``: std_msgs/Header, actionlib_msgs/GoalID, the goal.

    :return: the stamp in ns of ROS time.
    :raises ValueError: when the message is too short for that.
    """
    try:
        _, end = _text(message, 12)  # behind the header's seq and stamp
        seconds, nanoseconds = struct.unpack_from("<II", message, end)
        goal_id, _ = _text(message, end + 8)
    except struct.error as error:
        raise ValueError(f"{len(message)} bytes are not a goal message: {error}") from error
    return goal_id, seconds * 1_000_000_000 + nanoseconds


def _text(message: bytes, start: int) -> Tuple[str, int]:
    """A string of the message and the offset behind it."""
    (length,) = struct.unpack_from("<I", message, start)
    (text,) = struct.unpack_from(f"<{length}s", message, start + 4)
    return text.decode("utf-8", "replace"), start + 4 + length

# SPDX-License-Identifier: Apache-2.0
"""Who holds a base since when, of what its guard says; ROS time as a clock shows it. Without ROS."""

import time

CALENDAR = 1e8  # s; less is the time of a simulator, which began at zero


def clock_text(at: float) -> str:
    """``123.4 s`` in a simulation, else the time of the day."""
    return f"{at:.1f} s" if at < CALENDAR else time.strftime("%H:%M:%S", time.localtime(at))


def holder_of(reason: str) -> str:
    """Who stopped a base, of the guard's reason; empty: it names no operator (``stopped on the topic …``)."""
    return reason.partition("stopped by ")[2]


def hold_words(robot: str, reason: str, since: float) -> str:
    """Who holds a base since when: ``the base is held by Ana since 14:03:07``.

    :param robot: its name; empty: there is one base.
    :param reason: of its guard.
    :param since: s of ROS time.
    """
    how = reason.partition("stopped ")[2] or reason
    return f"{f'robot {robot}' if robot else 'the base'} is held {how} since {clock_text(since)}"

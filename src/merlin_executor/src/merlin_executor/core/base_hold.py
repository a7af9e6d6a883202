# SPDX-License-Identifier: Apache-2.0
"""The holder of a base, and since when, of what its guard says. Without ROS."""

from merlin_ros.work.passed_time import clock_text


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

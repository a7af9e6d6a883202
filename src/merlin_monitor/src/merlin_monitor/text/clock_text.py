"""ROS time as a clock shows it."""

import time

CALENDAR = 1e8  # s; less is the time of a simulator, which began at zero


def clock_text(at: float) -> str:
    """``123.4 s`` in a simulation, else the time of the day."""
    return f"{at:.1f} s" if at < CALENDAR else time.strftime("%H:%M:%S", time.localtime(at))

# SPDX-License-Identifier: Apache-2.0
"""The priority of a process: which one goes first where processors are scarce.

Call them before the first thread begins: Linux keeps a nice value for each thread, and a new thread takes its
creator's. Where the kernel groups processes by session (``sched_autogroup``; roslaunch makes one for each
node), the value of the group counts, so it is set as well, unless others share it.
"""

import contextlib
import os
import time
from pathlib import Path

_AUTOGROUP = Path("/proc/self/autogroup")
#: Linux lets ordinary users change the value of one group in each 0.1 s, all of them together; s.
_NEXT_CHANGE, _LAST_TRY = 0.1, 1.0


def lower_priority(niceness: int) -> None:
    """Lets other processes go first.

    :param niceness: nice value, 0 to 19; a process of a higher one keeps it, for its session too.
    """
    with contextlib.suppress(OSError):
        if os.getpriority(os.PRIO_PROCESS, 0) < niceness:
            os.setpriority(os.PRIO_PROCESS, 0, niceness)
        inherit_priority()


def raise_priority(niceness: int) -> bool:
    """Lets this process go before others, where the system allows it.

    :param niceness: nice value, -20 to -1.
    :return: whether it was allowed; root may, and a user with ``RLIMIT_NICE`` (systemd: ``LimitNICE``).
    """
    try:
        os.setpriority(os.PRIO_PROCESS, 0, niceness)
    except OSError:
        return False
    with contextlib.suppress(OSError):  # no such groups here, or changed a moment ago
        _set_group(niceness)
    return True


def inherit_priority() -> None:
    """Gives a session that a process has just begun, which has 0, the nice value of the process."""
    niceness = os.getpriority(os.PRIO_PROCESS, 0)
    with contextlib.suppress(OSError):
        if niceness:
            _set_group(niceness)


def _set_group(niceness: int) -> None:
    if os.getsid(0) != os.getpid():
        return
    end = time.monotonic() + _LAST_TRY
    while True:
        try:
            _AUTOGROUP.write_text(str(niceness), encoding="utf-8")
            return
        except BlockingIOError:
            if time.monotonic() > end:
                raise
            time.sleep(_NEXT_CHANGE)

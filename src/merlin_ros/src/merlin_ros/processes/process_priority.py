# SPDX-License-Identifier: Apache-2.0
"""The priority of a process: which one goes first where processors are scarce.

Call them before the first thread begins: Linux keeps a nice value for each thread, and a new thread takes its
creator's. Where the kernel groups processes by session (``sched_autogroup``; roslaunch makes one for each
node), the value of the group counts, so it is set as well, unless others share it.
"""

import contextlib
import os
from pathlib import Path

_AUTOGROUP = Path("/proc/self/autogroup")


def lower_priority(niceness: int) -> None:
    """Lets other processes go first.

    :param niceness: nice value, 0 to 19; a process of a higher one is left alone.
    """
    with contextlib.suppress(OSError):
        if os.getpriority(os.PRIO_PROCESS, 0) < niceness:
            os.setpriority(os.PRIO_PROCESS, 0, niceness)
            _set_group(niceness)


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
    """Gives a session that a process has just begun the nice value that the process has from its parent."""
    with contextlib.suppress(OSError):
        _set_group(os.getpriority(os.PRIO_PROCESS, 0))


def _set_group(niceness: int) -> None:
    if os.getsid(0) == os.getpid():
        _AUTOGROUP.write_text(str(niceness))

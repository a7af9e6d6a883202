"""The priority of the guard's process: what stops the base must not queue behind what drives it."""

import contextlib
import os
from pathlib import Path

PRIORITY = -10  # nice value: about nine times the share of a process at 0, and a short way to the processor

_AUTOGROUP = Path("/proc/self/autogroup")


def raise_priority() -> bool:
    """Raises the priority of this process, where the system allows it.

    It is called before the first thread begins: Linux keeps a nice value for each thread, and a new thread
    takes its creator's. Where the kernel groups processes by session (``sched_autogroup``), the value counts
    within the group only, so the group is raised as well, unless others share it.

    :return: whether it was allowed; root may, and a user with ``RLIMIT_NICE`` (systemd: ``LimitNICE``).
    """
    try:
        os.setpriority(os.PRIO_PROCESS, 0, PRIORITY)
    except OSError:
        return False
    if os.getsid(0) == os.getpid():
        with contextlib.suppress(OSError):  # no such groups here, or changed a moment ago
            _AUTOGROUP.write_text(str(PRIORITY))
    return True

# SPDX-License-Identifier: Apache-2.0
"""Whether this user may raise priorities: root of a container may not, a user with a limit for it may."""

import subprocess
import sys


def may_go_before_others(nice: int) -> bool:
    """Tries it in a process of its own.

    :param nice: value of the priority, below 0.
    """
    code = f"import os; os.setpriority(os.PRIO_PROCESS, 0, {nice})"
    return (
        subprocess.run([sys.executable, "-c", code], stderr=subprocess.DEVNULL, check=False).returncode == 0
    )

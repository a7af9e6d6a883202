# SPDX-License-Identifier: Apache-2.0
"""A planner that starts a process in a session of its own, and waits for it forever."""

import subprocess
import sys

MARK = "planner_child"  # by which the campaign finds it

child = subprocess.Popen(
    [sys.executable, "-c", "import time; time.sleep(600)", MARK],
    start_new_session=True,
    stdin=subprocess.DEVNULL,
)
child.wait()

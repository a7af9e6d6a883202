#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A process for the tests of the runner: `fake_node.py WHAT [ARGUMENT]`, without ROS, so it starts at once.

exit N      prints a line and ends with exit code N
wait        says it is ready and runs until a signal ends it
deaf        as wait, ignoring SIGINT and SIGTERM
litter      leaves a child in a process group of its own behind and ends with 0
talk        writes more to both outputs than a pipe takes, and ends with 0
"""

import os
import signal
import subprocess
import sys
import time

# roslaunch hands remappings over as words
words = [word for word in sys.argv[1:] if ":=" not in word]
what = words[0]
if what == "exit":
    print("mission: last line")
    sys.exit(int(words[1]))
if what == "litter":
    child = subprocess.Popen([sys.executable, __file__, "deaf"], start_new_session=True)
    print(f"mission: left {child.pid} behind", flush=True)
    sys.exit(0)
if what == "talk":
    for _ in range(4000):
        os.write(2, b"mission: a warning of some length, which is meant for a screen\n")
    print("mission: last line")
    sys.exit(0)


def interrupted(*_):
    os.write(1, b"mission: interrupted\n")  # the signal may come within a print
    sys.exit(0)


signal.signal(signal.SIGINT, interrupted)
if what == "deaf":
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
print(f"mission: ready {os.getpid()}", flush=True)
while True:
    time.sleep(60)

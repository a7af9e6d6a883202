# SPDX-License-Identifier: Apache-2.0
"""A planner that writes without end."""

import sys

LINE = "; still thinking about it, and about everything else that could be said here\n" * 1000

while True:
    sys.stdout.write(LINE)

# SPDX-License-Identifier: Apache-2.0
"""A planner that finds a plan of 100 MB."""

import sys

STEP = "{0}.000: (navigate anywhere kitchen) [25.000]\n"
SIZE = 100_000_000

steps = "".join(
    STEP.format(number) for number in range(10_000)
)  # written at once: parsing is what takes time
written = 0
while written < SIZE:
    written += sys.stdout.write(steps)

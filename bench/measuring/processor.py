# SPDX-License-Identifier: Apache-2.0
"""How fast this machine runs Python just now.

A shared machine runs the same code at different speeds within one day. Figures of two runs compare only by
the ratio of this one.
"""

import time
from typing import List

REPEATS = 5


def processor_ms() -> List[float]:
    """Processor time of a fixed piece of work with dictionaries and short strings, ms."""
    samples = []
    for _ in range(REPEATS):
        begun = time.process_time()
        _work()
        samples.append((time.process_time() - begun) * 1000.0)
    return samples


def _work() -> int:
    table = {}
    total = 0
    for number in range(200_000):
        table[number % 997] = total
        total += len(str(number))
    return total

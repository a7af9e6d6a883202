# SPDX-License-Identifier: Apache-2.0
"""The figures of a benchmark: median, p95 and p99 of repeated measurements."""

import time
from typing import Any, Callable, Dict, List, Sequence


def figure(samples: Sequence[float]) -> Dict[str, float]:
    """Median, 95th and 99th percentile and number of samples."""
    ordered: List[float] = sorted(samples)

    def percentile(fraction: float) -> float:
        return ordered[min(len(ordered) - 1, int(fraction * len(ordered)))]

    return {
        "median": round(percentile(0.5), 4),
        "p95": round(percentile(0.95), 4),
        "p99": round(percentile(0.99), 4),
        "n": len(ordered),
    }


def time_ms(call: Callable[[], Any], repeats: int, warm_up: int = 5) -> Dict[str, float]:
    """How long a call takes, ms."""
    for _ in range(warm_up):
        call()
    samples = []
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        samples.append((time.perf_counter() - start) * 1000.0)
    return figure(samples)

"""Noise as a function of seed, name and simulated time, never of the order of calls.

Two runs with the same seed see the same noise at the same simulated time, whoever else drew in between,
whether somebody subscribed or not, and at whatever real-time factor.
"""

import hashlib
import math
from functools import lru_cache
from typing import Tuple

import numpy as np


def draw(seed: int, name: str, index: int) -> np.random.Generator:
    """A generator for moment `index` of the stream `name`; equal arguments give equal numbers."""
    return np.random.Generator(np.random.Philox(key=_key(seed, name), counter=[0, index % 2**64, 0, 0]))


@lru_cache(maxsize=1024)
def _key(seed: int, name: str) -> np.ndarray:
    digest = hashlib.blake2b(f"{seed}/{name}".encode(), digest_size=16).digest()
    return np.frombuffer(digest, dtype=np.uint64)


class SmoothNoise:
    """Gaussian noise that wanders: a smooth function of time through independent values.

    :param sigmas: standard deviation of each component.
    :param period: time between independent values, s.
    """

    def __init__(self, seed: int, name: str, sigmas: Tuple[float, ...], period: float) -> None:
        self._seed, self._name = seed, name
        self._sigmas = np.array(sigmas)
        self._period = period

    def at(self, time: float) -> np.ndarray:
        """The value of each component at a time, s."""
        index = math.floor(time / self._period)
        phase = (time / self._period - index) * math.pi / 2
        # sin and cos of one angle keep the variance constant between the knots.
        return self._sigmas * (math.cos(phase) * self._knot(index) + math.sin(phase) * self._knot(index + 1))

    def _knot(self, index: int) -> np.ndarray:
        return draw(self._seed, self._name, index).standard_normal(len(self._sigmas))

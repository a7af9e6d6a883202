# SPDX-License-Identifier: Apache-2.0
"""Noise that wanders, as a function of seed, name and simulated time."""

import math
from functools import lru_cache
from typing import Tuple

import numpy as np

from merlin_reactive.seeded_random import draw


class SmoothNoise:
    """Gaussian noise that wanders: a smooth function of time through independent values.

    :param sigmas: standard deviation of each component.
    :param period: time between independent values, s.
    """

    def __init__(self, seed: int, name: str, sigmas: Tuple[float, ...], period: float) -> None:
        self._seed, self._name = seed, name
        self._sigmas = np.array(sigmas)
        self._period = period
        self._knot = lru_cache(maxsize=4)(self._draw)  # each is asked for at some fifty moments

    def at(self, time: float) -> np.ndarray:
        """The value of each component at a time, s."""
        index = math.floor(time / self._period)
        phase = (time / self._period - index) * math.pi / 2
        # sin and cos of one angle keep the variance constant between the knots.
        return self._sigmas * (math.cos(phase) * self._knot(index) + math.sin(phase) * self._knot(index + 1))

    def _draw(self, index: int) -> np.ndarray:
        return draw(self._seed, self._name, index).standard_normal(len(self._sigmas))

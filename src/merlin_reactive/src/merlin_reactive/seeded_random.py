# SPDX-License-Identifier: Apache-2.0
"""Random numbers as a function of seed, name and simulated time, never of the order of calls.

Two runs with the same seed draw the same numbers at the same simulated time: other draws in between,
subscribers and the real-time factor do not matter.
"""

import hashlib
from functools import lru_cache

import numpy as np


def draw(seed: int, name: str, index: int) -> np.random.Generator:
    """A generator for moment `index` of the stream `name`; equal arguments give equal numbers."""
    return np.random.Generator(np.random.Philox(key=_key(seed, name), counter=[0, index % 2**64, 0, 0]))


@lru_cache(maxsize=1024)
def _key(seed: int, name: str) -> np.ndarray:
    digest = hashlib.blake2b(f"{seed}/{name}".encode(), digest_size=16).digest()
    return np.frombuffer(digest, dtype=np.uint64)

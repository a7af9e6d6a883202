# SPDX-License-Identifier: Apache-2.0
"""Numbers on the command line: one that cannot be is refused in words."""

import argparse
import math
from typing import Callable


def option_number(
    words: str, least: float = -math.inf, most: float = math.inf, above: float = -math.inf
) -> Callable[[str], float]:
    """The `type` of an option of argparse that takes a finite number.

    :param words: what it has to be, as ``a number from 0 on``.
    :param least, most: the bounds that it may have.
    :param above: what it has to be greater than.
    """

    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not (math.isfinite(value) and above < value and least <= value <= most):
            raise argparse.ArgumentTypeError(f"{text} is not {words}")
        return value

    return read

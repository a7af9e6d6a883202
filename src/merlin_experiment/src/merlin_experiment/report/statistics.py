# SPDX-License-Identifier: Apache-2.0
"""The statistics of the report."""

import math
import statistics
from dataclasses import dataclass
from typing import Optional, Sequence, Tuple

from scipy import stats

CONFIDENCE = 0.95


@dataclass(frozen=True)
class Summary:
    """A sample.

    :ivar n: how many.
    :ivar mean: arithmetic mean.
    :ivar median: median.
    :ivar sd: standard deviation of the sample (n - 1); None for one value.
    """

    n: int
    mean: float
    median: float
    sd: Optional[float]

    @classmethod
    def of(cls, values: Sequence[float]) -> "Summary":
        """Summarises values; at least one."""
        sd = statistics.stdev(values) if len(values) > 1 else None
        return cls(len(values), statistics.fmean(values), statistics.median(values), sd)

    @property
    def variation(self) -> Optional[float]:
        """Coefficient of variation, sd / mean."""
        return None if self.sd is None or self.mean == 0 else self.sd / abs(self.mean)


@dataclass(frozen=True)
class Ratio:
    """The ratio of two means over paired runs.

    :ivar value: mean of the first over mean of the second.
    :ivar low: lower end of the confidence interval; None: fewer than two pairs.
    :ivar high: its upper end.
    :ivar each: the ratio of every pair.
    """

    value: float
    low: Optional[float]
    high: Optional[float]
    each: Tuple[float, ...]

    @property
    def pairs(self) -> int:
        """Number of compared pairs."""
        return len(self.each)

    @classmethod
    def of(cls, first: Sequence[float], second: Sequence[float]) -> "Ratio":
        """The ratio estimator for paired samples, with Student's t on its residuals.

        :param first: the measurements of one approach.
        :param second: those of the other on the same lists, in the same order.
        :raises ValueError: no pairs, or unequal numbers.
        """
        count = len(first)
        if count != len(second) or not count:
            raise ValueError(f"{count} and {len(second)} values are not pairs")
        below = statistics.fmean(second)
        ratio = statistics.fmean(first) / below
        each = tuple(a / b for a, b in zip(first, second))
        if count == 1:
            return cls(ratio, None, None, each)
        residuals = [a - ratio * b for a, b in zip(first, second)]
        error = math.sqrt(sum(r * r for r in residuals) / (count - 1) / count) / below
        reach = float(stats.t.ppf(0.5 + CONFIDENCE / 2, count - 1)) * error
        return cls(ratio, ratio - reach, ratio + reach, each)

# SPDX-License-Identifier: Apache-2.0
"""From rows of runs and tasks to the figures of the report, and their statistics."""

import math
import statistics
from collections import defaultdict
from dataclasses import dataclass
from statistics import fmean
from typing import Any, Dict, List, Optional, Sequence, Tuple

from experiment.run_table import Row

Key = Tuple[int, str]
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
        return cls(len(values), fmean(values), statistics.median(values), sd)

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
        below = fmean(second)
        ratio = fmean(first) / below
        each = tuple(a / b for a, b in zip(first, second))
        if count == 1:
            return cls(ratio, None, None, each)
        residuals = [a - ratio * b for a, b in zip(first, second)]
        error = math.sqrt(sum(r * r for r in residuals) / (count - 1) / count) / below
        from scipy import stats  # which is large, and what only lists runs does without

        reach = float(stats.t.ppf(0.5 + CONFIDENCE / 2, count - 1)) * error
        return cls(ratio, ratio - reach, ratio + reach, each)


class Analysis:
    """One set of runs."""

    def __init__(self, run_rows: Sequence[Row], task_rows: Sequence[Row]) -> None:
        self.runs = list(run_rows)
        self.tasks = list(task_rows)

    def only(self, **wanted: object) -> "Analysis":
        """The runs, and their tasks, whose columns have these values."""
        runs = [row for row in self.runs if all(row[name] == value for name, value in wanted.items())]
        names = {(row["set"], row["run"]) for row in runs}
        return Analysis(runs, [row for row in self.tasks if (row["set"], row["run"]) in names])

    def missions(self) -> List[int]:
        """Missions with a run."""
        return sorted({int(row["mission"]) for row in self.runs})

    def summaries(self, column: str) -> Dict[Key, Summary]:
        """Values of a column of the runs, by mission and approach; runs without a value are left out."""
        values: Dict[Key, List[float]] = defaultdict(list)
        for row in self.runs:
            if row[column] is not None:
                values[int(row["mission"]), row["approach"]].append(row[column])
        return {key: Summary.of(found) for key, found in values.items()}

    def pairs(self) -> List[Tuple[Row, Row]]:
        """MERLIN and Naive on the same list with the same settings, in the order of missions and seeds."""
        settings = ("mission", "seed", "cancel_after", "marked_share", "real_time_factor", "rtf_policy")
        by_settings: Dict[Tuple[Any, ...], Dict[str, Row]] = defaultdict(dict)
        for row in self.runs:
            by_settings[tuple(row[name] for name in settings)][row["approach"]] = row
        whole = {key: pair for key, pair in by_settings.items() if len(pair) == 2}
        return [(whole[key]["merlin"], whole[key]["naive"]) for key in sorted(whole)]

    def ratio(self, column: str, over: Optional[str] = None) -> Optional[Ratio]:
        """MERLIN over Naive of a column; `over`: another column of the Naive runs. None: no pairs."""
        pairs = self.pairs()
        if not pairs:
            return None
        return Ratio.of(
            [merlin[column] for merlin, _ in pairs], [naive[over or column] for _, naive in pairs]
        )

    def oracle_ratio(self) -> Optional[Ratio]:
        """The oracle's time for MERLIN's runs over Naive's measured time."""
        return self.ratio("oracle_time_s", over="time_s")

    def shares(self) -> Dict[Key, Dict[str, float]]:
        """Mean time of a run by what it went into, s, by mission and approach."""
        result: Dict[Key, Dict[str, float]] = {}
        for mission in self.missions():
            for approach in ("naive", "merlin"):
                part = self.only(mission=float(mission), approach=approach)
                if not part.runs:
                    continue
                count = len(part.runs)
                sums = {
                    name: sum(task[name] or 0.0 for task in part.tasks) / count
                    for name in ("deliberating_s", "navigating_s", "speaking_s", "time_s")
                }
                sums["other_s"] = sums["time_s"] - sum(
                    sums[name] for name in ("deliberating_s", "navigating_s", "speaking_s")
                )
                sums["after_cancel_s"] = sum(task["stopping_s"] or 0.0 for task in part.tasks) / count
                result[mission, approach] = sums
        return result

    def beyond_oracle(self, approach: str) -> Optional[Dict[str, float]]:
        """What completed tasks took beyond the oracle on average, s, and its parts without driving; `_m`: m.

        None where no task was completed.
        """
        done = [
            task
            for task in self.tasks
            if task["approach"] == approach and task["outcome"] == "SUCCEEDED" and not task["cancelled"]
        ]
        if not done:
            return None
        parts = ("deliberating_s", "navigating_s", "speaking_s")
        return {
            "time": fmean(task["time_s"] - task["oracle_time_s"] for task in done),
            "deliberating": fmean(task["deliberating_s"] or 0.0 for task in done),
            "between": fmean(task["time_s"] - sum(task[name] or 0.0 for name in parts) for task in done),
            "distance_m": fmean(task["distance_m"] - task["oracle_distance_m"] for task in done),
        }

    def task_means(self, approach: str) -> Dict[str, Optional[float]]:
        """Means over the tasks of an approach, s and (`_m`) m; None where there is no such task."""
        tasks = [task for task in self.tasks if task["approach"] == approach]
        return {
            "unmarked": _mean([task["time_s"] for task in tasks if not task["marked"]]),
            "marked": _mean([task["time_s"] for task in tasks if task["marked"]]),
            "unmarked_m": _mean([task["distance_m"] for task in tasks if not task["marked"]]),
            "marked_m": _mean([task["distance_m"] for task in tasks if task["marked"]]),
            "leg": _mean([task["navigating_s"] for task in tasks if task["outcome"] == "SUCCEEDED"]),
            "leg_m": _mean([task["distance_m"] for task in tasks if task["outcome"] == "SUCCEEDED"]),
            "stopping": _mean([task["stopping_s"] for task in tasks if task["cancel_sent"] is not None]),
            "deliberating": _mean(
                [task["deliberating_s"] for task in tasks if task["first_dispatch"] is not None]
            ),
        }


def _mean(values: Sequence[Optional[float]]) -> Optional[float]:
    known = [value for value in values if value is not None]
    return fmean(known) if known else None

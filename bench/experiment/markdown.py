# SPDX-License-Identifier: Apache-2.0
"""Text of the report: tables and numbers."""

from typing import Iterable, List, Optional, Sequence

from measuring import tables

from experiment.analysis import Ratio, Summary
from experiment.paper_results import PaperFigure

APPROACH_NAMES = {"naive": "Naive", "merlin": "MERLIN", "oracle": "oracle"}


def table(header: str, rows: Iterable[Sequence[object]]) -> str:
    """A table; the header's cells are separated by `|`."""
    return tables.markdown([name.strip() for name in header.split("|")], rows)


def section(title: str, *parts: str) -> str:
    """A section; empty parts are left out."""
    return "\n\n".join([f"## {title}", *filter(None, parts)])


def number(value: Optional[float], decimals: int) -> str:
    """A number; a dash for None."""
    return "-" if value is None else f"{value:.{decimals}f}"


def four_figures(summary: Summary) -> List[str]:
    """Mean, median, standard deviation, coefficient of variation."""
    return [
        number(summary.mean, 2),
        number(summary.median, 2),
        number(summary.sd, 2),
        number(summary.variation, 3),
    ]


def mean_and_variation(summary: Optional[Summary]) -> List[str]:
    """Mean and coefficient of variation."""
    if summary is None:
        return ["-", "-"]
    return [number(summary.mean, 3), number(summary.variation, 3)]


def paper_cell(figure: PaperFigure) -> str:
    """A figure of the paper; Mission 3 was run once."""
    if figure.sd != figure.sd:
        return f"{figure.mean:.0f}"
    return f"{figure.mean:.2f} [{figure.median:.2f}] ± {figure.sd:.2f}"


def ratio_cell(ratio: Ratio) -> str:
    """A ratio with its confidence interval."""
    if ratio.low is None or ratio.high is None:
        return f"{ratio.value:.3f} (one pair)"
    return f"{ratio.value:.3f} ({ratio.low:.3f} to {ratio.high:.3f})"


def spread_cell(ratio: Ratio) -> str:
    """A ratio with the least and the largest of its pairs: of few pairs an interval says little."""
    return f"{ratio.value:.3f} ({min(ratio.each):.3f} to {max(ratio.each):.3f})"

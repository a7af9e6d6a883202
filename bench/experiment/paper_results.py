# SPDX-License-Identifier: Apache-2.0
"""What the paper reports: its Table 1, and the text on Mission 3."""

from typing import Dict, NamedTuple, Tuple


class PaperFigure(NamedTuple):
    """Mean, median and standard deviation; the last two are None where the paper has one run."""

    mean: float
    median: float
    sd: float


_NONE = float("nan")

#: Time of a mission, s.
TIME: Dict[Tuple[int, str], PaperFigure] = {
    (1, "naive"): PaperFigure(178.20, 178.19, 6.03),
    (1, "merlin"): PaperFigure(104.46, 110.66, 12.30),
    (2, "naive"): PaperFigure(556.82, 557.54, 9.89),
    (2, "merlin"): PaperFigure(369.14, 373.31, 18.06),
    (3, "naive"): PaperFigure(3379.0, _NONE, _NONE),
    (3, "merlin"): PaperFigure(2154.0, _NONE, _NONE),
}

#: Distance of a mission, m.
DISTANCE: Dict[Tuple[int, str], PaperFigure] = {
    (1, "naive"): PaperFigure(46.65, 46.92, 2.05),
    (1, "merlin"): PaperFigure(21.72, 23.64, 3.94),
    (2, "naive"): PaperFigure(138.82, 139.20, 4.94),
    (2, "merlin"): PaperFigure(80.23, 78.50, 6.26),
    (3, "naive"): PaperFigure(844.0, _NONE, _NONE),
    (3, "merlin"): PaperFigure(475.0, _NONE, _NONE),
}


def paper_ratio(table: Dict[Tuple[int, str], PaperFigure], mission: int) -> float:
    """MERLIN over Naive."""
    return table[mission, "merlin"].mean / table[mission, "naive"].mean

# SPDX-License-Identifier: Apache-2.0
"""Tables of measurements: for the screen, in Markdown, and into a page; and what may end a measurement."""

import signal
from pathlib import Path
from typing import Iterable, List, Sequence

#: Signals that end a measurement.
ENDS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def aligned(lines: Sequence[Sequence[str]]) -> List[str]:
    """The lines of a table whose columns stand below each other."""
    widths = [max(map(len, column)) for column in zip(*lines)]
    return ["  ".join(cell.ljust(width) for cell, width in zip(line, widths)).rstrip() for line in lines]


def markdown(heads: Sequence[object], rows: Iterable[Sequence[object]]) -> str:
    """A table in Markdown."""
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join(f"| {' | '.join(map(str, line))} |" for line in lines)


def put_between(page: Path, begin: str, end: str, text: str) -> None:
    """Puts a text into a page, in the place of the one between two marks, which stand on lines of their own.

    :raises ValueError: when the page does not have them.
    """
    before, first, rest = page.read_text().partition(begin)
    _, last, after = rest.partition(end)
    if not (first and last):
        raise ValueError(f"{page} has no lines '{begin}' and '{end}' for the table")
    page.write_text(f"{before}{begin}\n{text}\n{end}{after}")


def end_as_by_ctrl_c() -> None:
    """Makes SIGTERM and SIGHUP end this process as SIGINT does.

    What follows the first of them changes nothing: an end that is broken off leaves processes behind.
    """
    for number in ENDS:
        signal.signal(number, _interrupt)


def _interrupt(number: int, _frame: object) -> None:
    for each in ENDS:
        signal.signal(each, lambda *_: None)
    raise KeyboardInterrupt(signal.Signals(number).name)

# SPDX-License-Identifier: Apache-2.0
"""The results of a campaign: a row per trial as CSV, and a table of faults and moments."""

import csv
import statistics
from pathlib import Path
from typing import Dict, Iterable, List, Optional, Sequence, Tuple

from measuring import tables

from chaos.moments import Moment
from chaos.result import Result

COLUMNS = (
    "number",
    "name",
    "fault",
    "moment",
    "cancel",
    "respawn",
    "seed",
    "delay_s",
    "fresh",
    "valid",
    "outcome",
    "stand_s",
    "answer_s",
    "next_s",
    "rtf",
    "load",
    "waited",
    "helped",
    "violations",
    "note",
    "stop_s",
    "named",
)
#: Lines of a page between which the table is written.
BEGIN, END = "<!-- campaign's table: begin -->", "<!-- campaign's table: end -->"
HEADS = (
    "fault",
    "moment",
    "trials",
    "stand p50 / max, s",
    "answer p50 / max, s",
    "next goal p50 / max, s",
    "violations",
)
#: Name of the trials whose fault was not done, because the system was broken before it.
UNTOUCHED = "before a fault"
PAGE_HEADS = ("fault", *(moment.value for moment in Moment), *HEADS[3:], "trials")


def row(number: int, result: Result, fresh: bool, named: Optional[bool] = None) -> Dict[str, str]:
    """A trial as a row of the CSV file.

    :param fresh: the system was started for it; else it had been through earlier trials.
    :param named: whether the robot named the fault as the reason of its failure; None: it was not asked.
    """
    trial, judgement = result.trial, result.judgement
    return {
        "number": str(number),
        "name": trial.name if result.struck else UNTOUCHED,
        "fault": trial.fault.name,
        "moment": trial.moment.value,
        "cancel": str(int(trial.cancel)),
        "respawn": str(int(not trial.alone)),
        "seed": str(trial.seed),
        "delay_s": f"{trial.delay:.3f}",
        "fresh": str(int(fresh)),
        "valid": str(int(judgement is not None)),
        "outcome": judgement.outcome if judgement else "",
        "stand_s": _number(judgement.stand if judgement else None),
        "answer_s": _number(judgement.answer if judgement else None),
        "next_s": _number(judgement.following if judgement else None),
        "rtf": f"{result.real_time_factor:.2f}",
        "load": f"{result.load:.1f}",
        "waited": f"{result.waited:.2f}",
        "helped": result.helped,
        "violations": " | ".join(judgement.violations) if judgement else "",
        "note": result.note,
        "stop_s": _number(judgement.stopping if judgement else None),
        "named": "" if named is None else str(int(named)),
    }


def append(path: Path, fields: Dict[str, str]) -> None:
    """Adds a row to a file, with the heads when it is new."""
    path.parent.mkdir(parents=True, exist_ok=True)
    new = not path.exists()
    with path.open("a", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)
        if new:
            writer.writeheader()
        writer.writerow(fields)


def read(path: Path) -> List[Dict[str, str]]:
    """The rows of a file."""
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def summary(rows: Iterable[Dict[str, str]]) -> List[Tuple[str, ...]]:
    """The table: a line per fault and moment, and one of all, as text."""
    groups: Dict[Tuple[str, str], List[Dict[str, str]]] = {}
    valid = [fields for fields in rows if fields["valid"] == "1"]
    for fields in valid:
        name = fields["name"] if fields["respawn"] == "1" else f"{fields['name']} (alone)"
        groups.setdefault((name, fields["moment"]), []).append(fields)
    lines = [(*key, *_figures(group)) for key, group in sorted(groups.items())]
    return [*lines, ("all", "", *_figures(valid))]


def named(rows: Iterable[Dict[str, str]]) -> str:
    """In how many trials the robot named what was broken, and of which faults it did not."""
    asked = [fields for fields in rows if fields.get("named")]
    missed = [f"{fields['name']} @{fields['moment']}" for fields in asked if fields["named"] == "0"]
    rest = f"; not of: {', '.join(missed)}" if missed else ""
    return f"why it failed: {len(asked) - len(missed)} of {len(asked)} answers name the fault{rest}"


def text(rows: Iterable[Dict[str, str]]) -> str:
    """The table for the screen, and below it why trials did not count."""
    rows = list(rows)
    lines = [HEADS, *summary(rows)]
    texts = tables.aligned(lines)
    notes = [fields["note"] for fields in rows if fields["valid"] != "1"]
    texts += [f"{notes.count(note)} did not count: {note}" for note in dict.fromkeys(notes)]
    return "\n".join(texts)


def markdown(rows: Iterable[Dict[str, str]]) -> str:
    """The table for a page: a line per fault, a column per moment. Pairs of nodes share the lines of their
    signals, and whether nodes come back by themselves is not distinguished."""
    valid = [fields for fields in rows if fields["valid"] == "1"]
    names = {fields["name"] for fields in valid}
    lines = [
        (line, *_moments([fields for fields in valid if _line_of(fields["name"]) == line]))
        for line in sorted({_line_of(name) for name in names})
    ]
    return tables.markdown(PAGE_HEADS, [*lines, ("all", *_moments(valid))])


def _line_of(name: str) -> str:
    targets, _, how = name.partition(":")
    return f"two nodes:{how}" if "+" in targets else name


def _moments(group: Sequence[Dict[str, str]]) -> Tuple[str, ...]:
    cells = []
    for moment in Moment:
        here = [fields for fields in group if fields["moment"] == moment.value]
        bad = sum(bool(fields["violations"]) for fields in here)
        cells.append((f"{len(here)}, {bad} bad" if bad else str(len(here))) if here else "")
    return (*cells, *_figures(group)[1:], _figures(group)[0])


def write_into(page: Path, rows: Iterable[Dict[str, str]]) -> None:
    """Puts the table into a page, in the place of the one between the marks.

    :raises ValueError: when the page has no marks.
    """
    tables.put_between(page, BEGIN, END, markdown(rows))


def _figures(group: Sequence[Dict[str, str]]) -> Tuple[str, ...]:
    bad = sum(bool(fields["violations"]) for fields in group)
    return (str(len(group)), *(_spread(group, key) for key in ("stand_s", "answer_s", "next_s")), str(bad))


def _spread(group: Sequence[Dict[str, str]], key: str) -> str:
    values = [float(fields[key]) for fields in group if fields[key]]
    return f"{statistics.median(values):.2f} / {max(values):.2f}" if values else "–"


def _number(value: Optional[float]) -> str:
    return "" if value is None else f"{value:.3f}"

# SPDX-License-Identifier: Apache-2.0
"""The four problems, and what is kept and printed of their runs. Without ROS."""

from typing import Any, Dict, Iterator, List, Mapping, NamedTuple, Optional, Sequence


class Problem(NamedTuple):
    """What the robot is asked for."""

    title: str
    goals: str
    urgent: str
    """Asked for while it is at the others."""


PROBLEMS = {
    1: Problem("fetch", "(is_at mug table) (is_at apple table)", "(is_at book sideboard)"),
    2: Problem("doors", "(is_at mug table) (is_at book desk)", "(is_at apple sideboard)"),
    3: Problem(
        "containers",
        "(is_at apple table) (is_at soap bin) (not (is_open fridge)) (not (is_open pantry))",
        "(is_at mug sideboard)",
    ),
    4: Problem(
        "battery",
        "(is_at apple table) (is_at soap bin) (is_at book desk)"
        " (not (is_open fridge)) (not (is_open pantry))",
        "(is_at mug sideboard)",
    ),
}


def problem_of(number: int) -> Problem:
    """A problem by its number.

    :raises ValueError: when there is no such problem.
    """
    if number not in PROBLEMS:
        raise ValueError(f"there is no problem {number}; the problems are {', '.join(map(str, PROBLEMS))}")
    return PROBLEMS[number]


class Run(NamedTuple):
    """One run."""

    problem: int
    seed: int
    solved: bool
    steps: int
    """Actions of the robot that began."""
    failed: int
    """Of these."""
    oracle: Optional[float]
    """Expected actions of a robot that knows where everything is; None: the goals cannot be reached."""
    time: float
    """s of the wall's time from the first goal to the last result."""
    replans: int
    planning: float
    """s of the wall's time."""
    cancels: int
    urgent: int
    """Urgent requests that held."""
    wrong: List[str]
    """What is not so, or is known wrongly, at the end."""

    def as_data(self) -> Dict[str, Any]:
        """Values of JSON."""
        return self._asdict()


def run_of(data: Mapping[str, Any]) -> Run:
    """A run from values of JSON."""
    return Run(**data)


TITLES = ("problem", "solved", "actions", "of them failed", "oracle", "time, s", "new plans", "planning, s")
AFTER = ("cancels", "urgent")


def table(runs: Sequence[Run]) -> Iterator[str]:
    """The lines of a table in Markdown: the means of each problem."""
    titles = [*TITLES, *AFTER]
    yield f"| {' | '.join(titles)} |"
    yield "|" + "---|" * len(titles)
    for number in sorted({run.problem for run in runs}):
        of_it = [run for run in runs if run.problem == number]
        known = [run.oracle for run in of_it if run.oracle is not None]
        title = PROBLEMS[number].title if number in PROBLEMS else "other"
        cells = [
            f"{number}, {title}",
            f"{sum(run.solved for run in of_it)} of {len(of_it)}",
            _mean([run.steps for run in of_it]),
            _mean([run.failed for run in of_it]),
            _mean(known),
            _mean([run.time for run in of_it]),
            _mean([run.replans for run in of_it]),
            _mean([run.planning for run in of_it]),
            str(sum(run.cancels for run in of_it)),
            str(sum(run.urgent for run in of_it)),
        ]
        yield f"| {' | '.join(cells)} |"


def _mean(values: Sequence[float]) -> str:
    return f"{sum(values) / len(values):.1f}" if values else "none"

# SPDX-License-Identifier: Apache-2.0
"""Plans as text, as ROSPlan passes them on: ``<time>: (<action> <arguments>)  [<duration>]`` per action."""

import re
from dataclasses import dataclass, replace
from typing import Dict, Iterable, List, Optional, Sequence, Tuple

#: Duration that stands for an action without one, s.
NO_DURATION = 0.001

#: How the reason begins with which a dispatcher ends a plan because the world has changed.
OUTDATED = "the plan no longer fits: "

#: What a dispatcher says of an action interface that it has lost: another process of it may come.
INTERFACE_GONE = "is gone, silent for "

#: How a plan begins that is to follow what runs now; PDDL text of actions comes behind it.
AFTER = "; after"

#: The latest time and longest duration of a plan, s: ROS counts its seconds in 32 bits.
LONGEST = 1e9

_LINE = re.compile(r"^\s*([^\s:]+)\s*:\s*\(([^()]*)\)+\s*\[\s*(?:D:\s*)?([^\s\];]+)\s*[^\]]*\]")
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
# a time and a colon, or something in parentheses: meant as an action, whatever is missing
_MEANT = re.compile(r"^\s*(?:[+-]?[\d.]+(?:[eE][+-]?\d+)?\s*:|\()")
_END = re.compile(r"\r\n|\r|\n")
_SYMBOL = re.compile(r"[^\s()?;:]+")


def call_text(name: str, args: Sequence[str]) -> str:
    """A name applied to arguments: an atom, a function term, a ground action."""
    return f"({' '.join((name, *args))})"


class PlanTextError(ValueError):
    """A line of a plan that cannot be read; the text names the line."""


@dataclass(frozen=True)
class PlanStep:
    """One action of a plan.

    :param time: when it starts, s from the start of the plan.
    :param name: PDDL operator.
    :param arguments: objects, in the order of the operator's parameters.
    :param duration: planned, s.
    :param line: in the text it was read from, from 1; 0 when it was not read.
    """

    time: float
    name: str
    arguments: Tuple[str, ...]
    duration: float = NO_DURATION
    line: int = 0

    def __str__(self) -> str:
        return call_text(self.name, self.arguments)


def is_action_line(line: str) -> bool:
    """Whether a line of a plan is meant as an action: it has all of ``[ ] ( ) :`` and is not a comment."""
    return all(sign in line for sign in "[]():") and not line.lstrip().startswith(";")


def parse_line(line: str) -> Optional[PlanStep]:
    """The action of one line, or None when the line is not an action or cannot be read."""
    try:
        return _step(line, 0)
    except PlanTextError:
        return None


def _step(line: str, number: int) -> PlanStep:
    found = _LINE.match(line)
    words = re.findall(r"[^ \t]+", found.group(2)) if found else []
    if not found or not words:
        raise PlanTextError(f"{_place(line, number)}, is not '<time>: (<action> <arguments>) [<duration>]'")
    time, duration = (
        _seconds(found.group(group), what, line, number) for group, what in ((1, "time"), (3, "duration"))
    )
    return PlanStep(time, words[0], tuple(words[1:]), duration, number)


def _seconds(text: str, what: str, line: str, number: int) -> float:
    if not _NUMBER.fullmatch(text):
        raise PlanTextError(f"{_place(line, number)}: the {what} '{_short(text)}' is not a number of seconds")
    seconds = float(text)
    if not 0.0 <= seconds <= LONGEST:
        raise PlanTextError(
            f"{_place(line, number)}: the {what} {_short(text)} is not between 0 and {LONGEST:g} s"
        )
    return seconds


def _place(line: str, number: int) -> str:
    return f"line {number}, '{_short(line.strip())}'"


def _short(text: str) -> str:
    return text if len(text) <= 80 else f"{text[:77]}..."


def parse_plan(text: str) -> List[PlanStep]:
    """The actions of a plan's text, by time; equal times keep their order.

    Planners write other lines around a plan: they are skipped. The first empty line after an action ends the
    plan. A text without any action is a plan only when it has nothing but comments.

    :raises PlanTextError: a line is meant as an action and cannot be read, its time or duration is negative
        or too large, or there is text and no action in it.
    """
    steps: List[PlanStep] = []
    other = ""  # the first line that is neither an action nor a comment
    for number, line in enumerate(_END.split(text), 1):
        if len(line.strip()) < 2:
            if steps:
                break
            if line.strip(" \t\0"):
                other = other or _place(line, number)
            continue
        if line.lstrip().startswith(";"):
            continue
        if is_action_line(line) or _MEANT.match(line):
            steps.append(_step(line, number))
        else:
            other = other or _place(line, number)
    if other and not steps:
        raise PlanTextError(f"{other}, is not an action, and there is none in the whole text")
    # Not every planner writes them in order, and the simple dispatcher goes by the list.
    return sorted(steps, key=lambda step: round(step.time, 6))


def format_plan(steps: Iterable[PlanStep]) -> str:
    """The plan as POPF writes it, one action per line."""
    return "".join(f"{_number(step.time)}: {step}  [{_number(step.duration)}]\n" for step in steps)


def _number(seconds: float) -> str:
    # Three digits as POPF; some planners separate happenings by less, and rounding would join them.
    return f"{seconds:.3f}" if abs(seconds - round(seconds, 3)) < 1e-7 else f"{seconds:.6f}"


def restore_case(steps: Iterable[PlanStep], problem: str) -> List[PlanStep]:
    """Gives objects the spelling that the problem has: planners print them in upper or lower case.

    Operators become lower-case, as ROSPlan's knowledge base names them. An object that the problem spells
    in two ways is left alone.
    """
    code = re.sub(r";[^\n]*", "", problem)
    spelling: Dict[str, Optional[str]] = {}
    for symbol in set(_SYMBOL.findall(code)):
        lower = symbol.lower()
        spelling[lower] = None if lower in spelling else symbol
    return [
        replace(
            step,
            name=step.name.lower(),
            arguments=tuple(spelling.get(argument.lower()) or argument for argument in step.arguments),
        )
        for step in steps
    ]

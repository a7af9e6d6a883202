"""Plans as text, as ROSPlan passes them on: ``<time>: (<action> <arguments>)  [<duration>]`` per action."""

import re
from dataclasses import dataclass
from typing import Dict, Iterable, List, Optional, Tuple

#: Duration that stands for an action without one, s.
NO_DURATION = 0.001

_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_LINE = re.compile(rf"^\s*({_NUMBER})\s*:\s*\(([^()]*)\)+\s*\[\s*(?:D:\s*)?({_NUMBER})\s*[^\]]*\]")
_SYMBOL = re.compile(r"[^\s()?;:]+")


class PlanTextError(ValueError):
    """A line of a plan that cannot be read; the text names the line."""


@dataclass(frozen=True)
class PlanStep:
    """One action of a plan.

    Parameters
    ----------
    time: when it starts, s from the start of the plan.
    name: PDDL operator.
    arguments: objects, in the order of the operator's parameters.
    duration: planned, s.
    line: in the text it was read from, from 1; 0 when it was not read.
    """

    time: float
    name: str
    arguments: Tuple[str, ...]
    duration: float = NO_DURATION
    line: int = 0

    def __str__(self) -> str:
        return "(" + " ".join((self.name,) + self.arguments) + ")"


def is_action_line(line: str) -> bool:
    """Whether a line of a plan is meant as an action: it has all of ``[ ] ( ) :`` and is no comment."""
    return all(sign in line for sign in "[]():") and not line.lstrip().startswith(";")


def parse_line(line: str, number: int = 0) -> Optional[PlanStep]:
    """The action of one line, or None when it is none or cannot be read."""
    found = _LINE.match(line)
    if not found:
        return None
    words = found.group(2).split()
    if not words:
        return None
    return PlanStep(float(found.group(1)), words[0], tuple(words[1:]), float(found.group(3)), number)


def parse_plan(text: str) -> List[PlanStep]:
    """The actions of a plan's text, by time; equal times keep their order.

    Lines that are no actions are skipped; the first empty line after an action ends the plan.

    Raises
    ------
    PlanTextError: a line has all the marks of an action and cannot be read.
    """
    steps: List[PlanStep] = []
    for number, line in enumerate(text.splitlines(), 1):
        if len(line.strip()) < 2:
            if steps:
                break
            continue
        if not is_action_line(line):
            continue
        step = parse_line(line, number)
        if step is None:
            raise PlanTextError(
                f"line {number}, '{line.strip()}', is not '<time>: (<action> <arguments>) [<duration>]'"
            )
        steps.append(step)
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
        PlanStep(
            step.time,
            step.name.lower(),
            tuple(spelling.get(argument.lower()) or argument for argument in step.arguments),
            step.duration,
            step.line,
        )
        for step in steps
    ]

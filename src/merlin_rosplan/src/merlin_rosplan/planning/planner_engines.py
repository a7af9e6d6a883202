# SPDX-License-Identifier: Apache-2.0
"""Which engines a ``planner_command`` names: kairos, a command, a planner's name, or two joined by ``+``."""

from typing import List, NamedTuple, Optional

from merlin_pddl.checks.installed_planners import STAND_INS, expand, is_preset, stand_in
from merlin_pddl.checks.kairos_check import available
from merlin_rosplan.planning.planner_command import PlannerCommandError, parse_command
from merlin_rosplan.planning.planner_kairos import KAIROS, MISSING

MOST = 2


class Engines(NamedTuple):
    """What is to plan.

    :param commands: ``kairos`` or whole command lines, at most two.
    :param name: for messages.
    :param limit: the longest time that a ``timeout N`` in a command grants, s; None: no limit.
    :param warning: why an engine was left out, or does not see the problem.
    """

    commands: List[str]
    name: str
    limit: Optional[float]
    warning: Optional[str]


def engines(text: str, fallback: bool) -> Engines:
    """The engines that are installed.

    :param text: a ``planner_command``.
    :param fallback: leave out what is not installed, and use kairos when nothing is left; where only kairos
        is asked for and is not installed, use what can stand in for it.
    :raises PlannerCommandError: the text cannot be run.
    """
    wanted = _parts(text)
    if len(wanted) > MOST:
        raise PlannerCommandError(f"'{text}' names {len(wanted)} engines: at most {MOST} run at a time")
    found: List[str] = []
    names: List[str] = []
    limits: List[float] = []
    missing: List[str] = []
    warning = None
    instead = stand_in() if fallback and wanted == [KAIROS] and not available() else None
    if instead is not None:
        wanted = [instead]
    for part in wanted:
        if part.lower() == KAIROS:
            if available():
                found.append(KAIROS)
                names.append(KAIROS)
            elif len(wanted) == 1:
                raise PlannerCommandError(MISSING)
            else:
                missing.append(KAIROS)
            continue
        line = expand(part)
        command = parse_command(line)
        if command.program_path() is None:
            missing.append(command.program)
            continue
        if instead is not None:
            warning = f"kairos is not installed; {instead} plans instead, and reads no {STAND_INS[instead]}"
        if not command.reads_problem:
            warning = f"planner command '{line}' lacks the placeholder PROBLEM: it plans without the problem"
        found.append(line)
        names.append(command.name)
        if command.limit is not None:
            limits.append(command.limit)
    if missing and not fallback:
        raise PlannerCommandError(f"the planner {missing[0]} is not installed")
    if missing:
        if not found and not available():
            raise PlannerCommandError(f"the planner {missing[0]} is not installed, and {MISSING}")
        found, names = found or [KAIROS], names or [KAIROS]
        plans = "plan" if len(names) > 1 else "plans"
        warning = f"the planner {missing[0]} is not installed; {' and '.join(names)} {plans} instead"
    return Engines(found, "+".join(names), max(limits) if limits else None, warning)


def _parts(text: str) -> List[str]:
    if not text.strip():
        return [KAIROS]
    parts = [part.strip() for part in text.split("+")]
    if all(part.lower() == KAIROS or is_preset(part) for part in parts):
        return parts
    # A command line may hold a plus sign; only one between blanks joins engines.
    return [part.strip() for part in text.split(" + ")]

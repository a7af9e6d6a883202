# SPDX-License-Identifier: Apache-2.0
"""Which engines a ``planner_command`` names: kairos, one command, a planner's name, or two joined by ``+``.

A planner with a name is looked for on PATH, then among the Python packages of the engines of
unified-planning: in this environment, and in the one that ``MERLIN_PLANNERS`` names.
"""

import glob
import importlib.util
import os
import re
import shlex
import shutil
import sys
from typing import Dict, List, NamedTuple, Optional, Tuple

from merlin_rosplan.planning.planner_command import PlannerCommandError, parse_command
from merlin_rosplan.planning.planner_kairos import KAIROS, MISSING, installed

#: Variable with the folder of a virtual environment that holds planners.
PLANNERS = "MERLIN_PLANNERS"
_UNIFIED_PLANNING = re.compile(r"up:([A-Za-z][\w-]*)\Z")


class _Preset(NamedTuple):
    """Where a planner is found (on PATH, or inside a Python package) and how it is called."""

    programs: List[str]
    package: str
    inside: str
    arguments: str
    runner: str = ""  # "python" or another program that runs the file; empty: it runs by itself


_PRESETS: Dict[str, _Preset] = {
    "fast-downward": _Preset(
        ["fast-downward", "fast-downward.py"],
        "up_fast_downward",
        "downward/fast-downward.py",
        "--alias lama-first DOMAIN PROBLEM",
        "python",
    ),
    "symk": _Preset(
        ["symk"], "up_symk", "symk/fast-downward.py", "DOMAIN PROBLEM --search 'sym_bd()'", "python"
    ),
    "lpg": _Preset(["lpg", "lpg-td"], "up_lpg", "lpg", "-o DOMAIN -f PROBLEM -n 1 -out plan"),
    "enhsp": _Preset(["enhsp"], "up_enhsp", "ENHSP/enhsp.jar", "-o DOMAIN -f PROBLEM", "java -jar"),
}


def is_preset(text: str) -> bool:
    """Whether a planner has this name."""
    name = text.strip().lower()
    return name in _PRESETS or _UNIFIED_PLANNING.match(name) is not None


def expand(command: str) -> str:
    """The command line behind a planner's name; any other command stays as it is.

    A planner that is not installed expands to a command whose program does not exist.
    """
    name = command.strip().lower()
    engine = _UNIFIED_PLANNING.match(name)
    if engine is not None:
        return _unified_planning(engine.group(1))
    preset = _PRESETS.get(name)
    if preset is None:
        return command
    program = next((path for path in map(shutil.which, preset.programs) if path), None)
    if program is not None:
        return f"{shlex.quote(program)} {preset.arguments}"
    found = _inside(preset.package, preset.inside)
    if found is None:
        return f"{preset.programs[0]} {preset.arguments}"
    python, path = found
    runner = shlex.quote(python) if preset.runner == "python" else preset.runner
    return f"{runner} {shlex.quote(path)} {preset.arguments}".lstrip()


def _unified_planning(engine: str) -> str:
    """Any engine of unified-planning, by the library's own command; its plan goes to a file."""
    arguments = f"oneshot-planning --pddl DOMAIN PROBLEM --engine {engine} --plan plan"
    found = _inside("unified_planning", "cmd/up.py")
    if found is None:
        return f"up {arguments}"
    return f"{shlex.quote(found[0])} -m unified_planning.cmd.up {arguments}"


def _inside(package: str, path: str) -> Optional[Tuple[str, str]]:
    """The Python that has a package, and the full path of one of the package's files."""
    spec = importlib.util.find_spec(package)
    for folder in (spec.submodule_search_locations or []) if spec is not None else []:
        full = os.path.join(folder, path)
        if os.path.exists(full):
            return sys.executable, full
    planners = os.environ.get(PLANNERS, "")
    if planners:
        pattern = os.path.join(glob.escape(planners), "lib", "python3*", "site-packages", package, path)
        for full in glob.glob(pattern):
            return os.path.join(planners, "bin", "python"), full
    return None


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
    :param fallback: leave out what is not installed, and use kairos when nothing is left.
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
    for part in wanted:
        if part.lower() == KAIROS:
            if installed():
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
        if not command.reads_problem:
            warning = f"planner command '{line}' lacks the placeholder PROBLEM: it plans without the problem"
        found.append(line)
        names.append(command.name)
        if command.limit is not None:
            limits.append(command.limit)
    if missing and not fallback:
        raise PlannerCommandError(f"the planner {missing[0]} is not installed")
    if missing:
        if not found and not installed():
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

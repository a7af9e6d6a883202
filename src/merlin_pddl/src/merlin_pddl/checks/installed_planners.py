# SPDX-License-Identifier: Apache-2.0
"""Planners that have a name: where they are, how they are called, and which stands in for kairos.

A planner is looked for on PATH, then among the Python packages of the engines of unified-planning: in this
environment, and in the one that ``MERLIN_PLANNERS`` names.
"""

import glob
import importlib.util
import os
import re
import shlex
import shutil
import sys
from typing import Dict, List, NamedTuple, Optional, Tuple

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


#: Of ROSPlan, in a folder of packages.
_POPF = "rosplan_planning_system/common/bin/popf"
#: What reads durative actions, and so can stand in for kairos, in this order; and what it does not read: popf
#: by its documents, lpg as the wheel up-lpg was tried.
STAND_INS = {
    "popf": "negative or disjunctive conditions over what changes, conditional effects, derived predicates, "
    "constraints and preferences",
    "lpg": "conditional effects, durations of a range, continuous effects, constraints and preferences",
}
_PRESETS: Dict[str, _Preset] = {
    "popf": _Preset(["popf"], "", "", "DOMAIN PROBLEM"),
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
    if program is None and name == "popf":
        program = _popf_of_rosplan()
    if program is not None:
        return f"{shlex.quote(program)} {preset.arguments}"
    found = _inside(preset.package, preset.inside) if preset.package else None
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


def _popf_of_rosplan() -> Optional[str]:
    for folder in filter(None, os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep)):
        for inner in ("", "*"):  # packages of a workspace lie in the folder of their repository
            for path in glob.glob(os.path.join(glob.escape(folder), inner, _POPF)):
                if shutil.which(path):
                    return path
    return None


def stand_in() -> Optional[str]:
    """The name of an installed planner that can stand in for kairos; None: there is none."""
    return next((name for name in STAND_INS if shutil.which(shlex.split(expand(name))[0])), None)

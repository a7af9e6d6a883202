"""Planners with a name of their own: ``planner_command: fast-downward`` instead of a whole command line."""

import importlib.util
import os
import shlex
import shutil
import sys
from typing import Dict, List, NamedTuple, Optional


class _Preset(NamedTuple):
    """Where a planner is found (on PATH, or inside a Python package) and how it is called."""

    programs: List[str]
    package: str
    inside: str
    arguments: str
    interpreted: bool


_PRESETS: Dict[str, _Preset] = {
    "fast-downward": _Preset(
        ["fast-downward", "fast-downward.py"],
        "up_fast_downward",
        "downward/fast-downward.py",
        "--alias lama-first DOMAIN PROBLEM",
        True,
    ),
    "lpg": _Preset(["lpg", "lpg-td"], "up_lpg", "lpg", "-o DOMAIN -f PROBLEM -n 1 -out plan", False),
}


def expand(command: str) -> str:
    """The command line behind a planner's name; any other command stays as it is.

    A planner that is not installed expands to a command whose program does not exist.
    """
    preset = _PRESETS.get(command.strip().lower())
    if preset is None:
        return command
    program = next((path for path in map(shutil.which, preset.programs) if path), None)
    if program is not None:
        return f"{shlex.quote(program)} {preset.arguments}"
    inside = _inside(preset.package, preset.inside)
    if inside is None:
        return f"{preset.programs[0]} {preset.arguments}"
    prefix = f"{shlex.quote(sys.executable)} " if preset.interpreted else ""
    return f"{prefix}{shlex.quote(inside)} {preset.arguments}"


def _inside(package: str, path: str) -> Optional[str]:
    spec = importlib.util.find_spec(package)
    for folder in (spec.submodule_search_locations or []) if spec is not None else []:
        full = os.path.join(folder, path)
        if os.path.exists(full):
            return full
    return None

# SPDX-License-Identifier: Apache-2.0
"""The command line of an external planner: ``timeout 10 /opt/popf/popf -n DOMAIN PROBLEM``."""

import os
import re
import shlex
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import List, Optional

# With the quotes around it: a path brings its own.
_PLACEHOLDER = re.compile(r"(?<![\w/.-])(?P<quote>['\"]?)(?P<name>DOMAIN|PROBLEM)(?P=quote)(?![\w/])")
_LPG_OUTPUT = re.compile(r"-out\s+\S+")
_TIMEOUT_VALUE_OPTIONS = {"-k", "-s", "--kill-after", "--signal"}
_UNITS = {"s": 1.0, "m": 60.0, "h": 3600.0, "d": 86400.0}


class PlannerCommandError(ValueError):
    """A planner command that cannot be run; the text says why."""


@dataclass(frozen=True)
class PlannerCommand:
    """What a ``planner_command`` says.

    :param text: the command as it was given, with the placeholders DOMAIN and PROBLEM.
    :param program: the planner itself, behind ``timeout 10``, ``nice`` and settings of variables.
    :param limit: s that a leading ``timeout N`` grants, None without one.
    """

    text: str
    program: str
    limit: Optional[float]

    @property
    def name(self) -> str:
        """Name of the planner, without its folder; behind an interpreter that of its script."""
        words = shlex.split(self.text)
        name = os.path.basename(self.program)
        if re.match(r"(?:python|java|bash|sh|mono|perl)[\d.]*$", name):
            for word in words[words.index(self.program) + 1 :]:
                if not word.startswith("-"):
                    return os.path.basename(word)
        return name

    @property
    def reads_problem(self) -> bool:
        """Whether the problem is among its arguments: a script that prints a stored plan needs none."""
        return any(match["name"] == "PROBLEM" for match in _PLACEHOLDER.finditer(self.text))

    def program_path(self) -> Optional[str]:
        """Where the program is, None when it is missing or not executable."""
        return shutil.which(self.program)

    def arguments(self, domain: Path, problem: Path, directory: Path) -> List[str]:
        """The command to start: a shell with all placeholders filled in.

        :param domain, problem: absolute paths; they stand for the first DOMAIN and the first PROBLEM.
        :param directory: where the planner runs and LPG's ``-out`` goes.
        """
        paths = {"DOMAIN": str(domain), "PROBLEM": str(problem)}

        def fill(match: "re.Match[str]") -> str:
            path = paths.pop(match["name"], None)
            return match.group(0) if path is None else shlex.quote(path)

        text = _PLACEHOLDER.sub(fill, self.text)
        if self.name.lower().startswith("lpg"):
            text = _LPG_OUTPUT.sub(f"-out {shlex.quote(str(directory / 'lpgplan'))}", text)
        if os.sep in self.program and not os.path.isabs(self.program):
            # The planner runs in a folder of its own; a relative path was meant from ours.
            escaped = re.sub(r"([^\w/.-])", r"\\\1", self.program)
            spelt = (f"'{self.program}'", f'"{self.program}"', self.program, escaped)
            found = next((each for each in spelt if each in text), self.program)
            text = text.replace(found, shlex.quote(os.path.abspath(self.program)), 1)
        return ["/bin/sh", "-c", text]


def parse_command(text: str) -> PlannerCommand:
    """Takes a command apart.

    :raises PlannerCommandError: quotes do not match, or there is no program.
    """
    try:
        words = shlex.split(text)
    except ValueError as error:
        raise PlannerCommandError(f"planner command '{text}': {error}") from None
    limit: Optional[float] = None
    index = 0
    while index < len(words):
        word = words[index]
        if re.match(r"^[A-Za-z_]\w*=", word) or word in ("exec", "nohup", "env"):
            index += 1
        elif os.path.basename(word) == "timeout":
            index += 1
            while index < len(words) and words[index].startswith("-"):
                index += 2 if words[index] in _TIMEOUT_VALUE_OPTIONS else 1
            if index < len(words):
                limit = _seconds(words[index])
            index += 1
        elif os.path.basename(word) == "nice":
            index += 1
            while index < len(words) and words[index].startswith("-"):
                index += 2 if words[index] == "-n" else 1
        else:
            break
    if index >= len(words):
        raise PlannerCommandError(f"planner command '{text}' names no program")
    return PlannerCommand(text, words[index], limit)


def _seconds(word: str) -> Optional[float]:
    match = re.match(r"^(\d+(?:\.\d*)?)([smhd]?)$", word)
    return float(match.group(1)) * _UNITS[match.group(2) or "s"] if match else None

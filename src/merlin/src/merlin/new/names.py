# SPDX-License-Identifier: Apache-2.0
"""Which names a new package, an operator and its parameters may have, and why not."""

import importlib.util
import keyword
import re
import sys
from typing import Collection, Mapping

import yaml

from merlin_pddl.checks.portability import KEYWORDS

#: Longest name, characters: with it no line of the written files is longer than ruff allows.
LONGEST = 30
#: Most parameters of an operator, for the same reason.
MOST_PARAMETERS = 8
#: Targets that CMake and catkin make themselves: a package, which is a target too, cannot have these names.
TARGETS = {
    *("all", "build", "catkin", "check", "clean", "depend", "devel", "docs", "doxygen", "edit_cache", "help"),
    *("install", "package", "rebuild_cache", "run_tests", "src", "test", "tests", "toplevel"),
}
#: Names that every new domain has already.
READY = {
    "navigate": "comes with MERLIN (merlin_actions.actions.navigate:Navigate)",
    "robot_at": "is a predicate of the new domain",
    "travel_time": "is a function of the new domain",
}

_PACKAGE = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*\Z")
_ROBOT = re.compile(r"[a-z][a-z0-9_]*\Z")
_OPERATOR = re.compile(r"[a-z][a-z0-9]*([_-][a-z0-9]+)*\Z")
_LIMITS = f"at most {LONGEST} characters"


class NameRefused(ValueError):
    """A name cannot be used; the text says which, why, and what to do."""


def check_package(name: str, known: Collection[str] = ()) -> None:
    """Checks the name of a new package.

    :param known: packages that exist.
    :raises NameRefused: when catkin, CMake, Python or another package is in the way.
    """
    _check_form(
        "package", name, _PACKAGE, "lower case, digits and single _, beginning with a letter (REP 144)"
    )
    if len(name) < 2:
        raise NameRefused(f"package '{name}': catkin asks for two characters or more")
    if name in TARGETS:
        raise NameRefused(f"package '{name}': CMake or catkin has a target of this name; take another one")
    _check_keyword("package", name)
    if name in known:
        raise NameRefused(f"package '{name}': there is a ROS package of this name already; take another one")
    if name in sys.builtin_module_names or importlib.util.find_spec(name) is not None:
        raise NameRefused(f"package '{name}' would hide the Python module {name}; take another name")


def check_operator(name: str, ready: Mapping[str, str] = READY) -> None:
    """Checks the name of an action.

    :param ready: what its domain has already → what that is; a domain that exists has nothing else.
    :raises NameRefused: when PDDL, Python or a ready action is in the way.
    """
    _check_form("action", name, _OPERATOR, "lower case, digits, _ and -, beginning with a letter")
    if name in ready:
        raise NameRefused(f"action '{name}' {ready[name]}; leave it out, or take another name")
    _check_pddl("action", name)
    _check_keyword("action", module_name(name))
    _check_keyword("action", class_name(name))


def check_symbol(kind: str, name: str) -> None:
    """Checks the name of a parameter (without ``?``) or of a type.

    :raises NameRefused: when it is a keyword of PDDL or too long.
    """
    _check_form(kind, name, _OPERATOR, "lower case, digits, _ and -, beginning with a letter")
    _check_pddl(kind, name)


def check_robot(name: str) -> None:
    """Checks the name of a robot, which is its namespace and an object of the problem.

    :raises NameRefused: when it has other signs, is too long, a keyword of PDDL or not a text in YAML.
    """
    _check_form("robot", name, _ROBOT, "lower case, digits and _, beginning with a letter")
    read = yaml.safe_load(name)  # so do launch files
    if not isinstance(read, str):
        raise NameRefused(f"robot '{name}': YAML reads it as {read}; take another name")
    _check_pddl("robot", name)


def module_name(operator: str) -> str:
    """The module of an operator's class: ``pick-up`` → ``pick_up``."""
    return operator.replace("-", "_")


def class_name(operator: str) -> str:
    """The class of an operator: ``pick-up`` → ``PickUp``."""
    return "".join(part[:1].upper() + part[1:] for part in module_name(operator).split("_"))


def needs_operator(operator: str) -> bool:
    """Whether the class has to name its operator, because its own name does not lead back to it."""
    parts = operator.split("_")
    return "-" in operator or not all(part[0].isalpha() and len(part) > 1 for part in parts)


def _check_form(kind: str, name: str, form: "re.Pattern[str]", words: str) -> None:
    if form.match(name) is None:
        raise NameRefused(f"{kind} '{name}': a name has {words}")
    if len(name) > LONGEST:
        raise NameRefused(f"{kind} '{name}': a name has {_LIMITS}")


def _check_keyword(kind: str, name: str) -> None:
    if keyword.iskeyword(name) or keyword.iskeyword(name.capitalize()):
        raise NameRefused(f"{kind} '{name}': this is a keyword of Python; take another name")


def _check_pddl(kind: str, name: str) -> None:
    if name in KEYWORDS or name in ("object", "number", "at"):
        raise NameRefused(f"{kind} '{name}': this is a keyword of PDDL; take another name")

# SPDX-License-Identifier: Apache-2.0
"""Writes the files of a new application, all of them or none."""

import json
import re
import shutil
import stat
import sys
import tempfile
import textwrap
from pathlib import Path
from typing import Any, Dict, List, Mapping, Sequence, Tuple

import jinja2
import yaml

from merlin.new.application import ApplicationRefused, NewApplication
from merlin_pddl.domain import Signature
from merlin_pddl.domain_reader import parse_domain

TEMPLATES = Path(__file__).parent / "templates"
#: Characters of a line of the written Python.
WIDTH = 110

#: Template → path below the package, with {name}.
FILES = {
    "package.xml": "package.xml",
    "CMakeLists.txt": "CMakeLists.txt",
    "setup.py": "setup.py",
    "ruff.toml": "ruff.toml",
    "pytest.ini": "pytest.ini",
    "README.md": "README.md",
    "domain.pddl": "pddl/domain.pddl",
    "problem.pddl": "pddl/problem.pddl",
    "sentences.yaml": "pddl/sentences.yaml",
    "world.yaml": "worlds/{name}.yaml",
    "app.launch": "launch/{name}.launch",
    "init.py": "src/{name}/__init__.py",
    "mission.py": "src/{name}/mission.py",
    "actions/init.py": "src/{name}/actions/__init__.py",
    "app.test": "test/{name}.test",
    "mission_test.py": "test/mission_test.py",
    "test_actions.py": "test/test_{name}_actions.py",
}
EXECUTABLE = ("test/mission_test.py",)


def files_of(application: NewApplication, python: str = sys.executable) -> Dict[str, str]:
    """The files of a package: path → text.

    :param python: the interpreter for which it is built.
    """
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(str(TEMPLATES)),
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
        autoescape=False,
    )

    def render(template: str, **values: Any) -> str:
        return str(environment.get_template(f"{template}.j2").render(app=application, **values))

    values: Dict[str, Any] = {
        "python": python,
        "key": _key,
        "classes": _classes(application),
        "imports": _imports(application),
        "servers": repr(application.servers).replace("'", '"'),
        "goals": [_literal(goal, 4) for goal in application.goals],
        "plain_points": [name for name in application.points if name not in application.objects],
    }
    text = application.domain_text or render("domain.pddl", **values)
    domain = parse_domain(text, "domain.pddl")
    values.update(
        operators=_examples(domain.operators),
        predicates=_examples(domain.predicates),
        objects=[_key(name) for name in (*application.points, *application.objects, *application.robots)],
    )
    found = {
        path.format(name=application.package): render(template, **values) for template, path in FILES.items()
    }
    for action in application.actions:
        found[f"src/{application.package}/actions/{action.module}.py"] = render(
            "actions/action.py", action=action, parameters=_list(action.parameters)
        )
    if application.reserves:
        found[f"src/{application.package}/actions/navigate.py"] = render("actions/navigate.py")
    if application.domain_text:
        found.update(
            {"pddl/domain.pddl": application.domain_text, "pddl/problem.pddl": application.problem_text}
        )
    return found


def write_application(application: NewApplication, workspace: Path, python: str = sys.executable) -> Path:
    """Writes a package into a workspace, which is made when it does not exist.

    Everything is written into a temporary folder first and renamed at the end: nothing is ever overwritten,
    and nothing is left when a step fails.

    :return: the folder of the package.
    :raises ApplicationRefused: when something is in the way.
    :raises OSError: when the folder cannot be written.
    """
    target = workspace / "src" / application.package
    new = not workspace.exists()
    if not new and not (workspace / "src").is_dir():
        raise ApplicationRefused(
            f"{workspace} exists and is not a catkin workspace (no folder src); take another folder"
        )
    if target.exists() or target.is_symlink():
        raise ApplicationRefused(f"{target} exists already; nothing is overwritten")
    if not workspace.parent.is_dir():
        raise ApplicationRefused(f"there is no folder {workspace.parent}")
    folder = Path(tempfile.mkdtemp(prefix=".merlin_new_", dir=str(workspace.parent if new else workspace)))
    try:
        package = folder / "src" / application.package
        for path, text in files_of(application, python).items():
            file = package / path
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text, encoding="utf-8")
            if path in EXECUTABLE:
                file.chmod(file.stat().st_mode | stat.S_IXUSR | stat.S_IXGRP | stat.S_IXOTH)
        folder.chmod(0o755)
        # A folder that came meanwhile is not replaced: renaming fails unless it is empty.
        source, made = (folder, workspace) if new else (package, target)
        try:
            source.rename(made)
        except OSError as error:
            if not made.exists():
                raise
            raise ApplicationRefused(f"{made} has come meanwhile; nothing is overwritten") from error
    finally:
        shutil.rmtree(str(folder), ignore_errors=True)
    return target


def _examples(named: Mapping[str, Signature]) -> List[Tuple[str, str]]:
    """The names of a domain as keys of YAML, each with a text that has its parameters."""
    return [
        (
            _key(name),
            " ".join([name.replace("_", " "), *(f"{{{each.label}}}" for each in signature.parameters)]),
        )
        for name, signature in named.items()
    ]


def _key(name: str) -> str:
    """A name as YAML reads it: `on` is a truth value there."""
    return name if isinstance(yaml.safe_load(name), str) else json.dumps(name)


def _classes(application: NewApplication) -> str:
    """The action classes as a YAML list over as few lines as are needed."""
    own = application.package if application.reserves else "merlin_actions"
    ready = [f"{own}.actions.navigate:Navigate"] if application.navigates else []
    paths = [f"{application.package}.actions.{a.module}:{a.class_name}" for a in application.actions]
    lines = textwrap.wrap(", ".join([*ready, *paths]), 100, break_long_words=False, break_on_hyphens=False)
    return "\n      ".join(lines)


def _imports(application: NewApplication) -> List[str]:
    """The imports of the action classes, sorted and folded as ruff does it."""
    lines = []
    for action in sorted(application.actions, key=lambda action: _natural(action.module)):
        begin = f"from {application.package}.actions.{action.module} import "
        short = len(begin) + len(action.class_name) <= WIDTH
        lines.append(begin + (action.class_name if short else f"(\n    {action.class_name},\n)"))
    return lines


def _natural(name: str) -> List[Tuple[int, str]]:
    """A key by which load_2 comes before load_10."""
    return [(int(part), "") if part.isdigit() else (0, part) for part in re.split(r"(\d+)", name)]


def _literal(text: str, indent: int) -> str:
    """A string literal, folded when it is too long for a line."""
    if len(text) + indent + 3 <= WIDTH:
        return json.dumps(text)
    parts = textwrap.wrap(text, WIDTH - indent - 10, drop_whitespace=False, break_long_words=False)
    folded = "".join(f"\n{' ' * (indent + 4)}{json.dumps(part)}" for part in parts)
    return f"({folded}\n{' ' * indent})"


def _list(names: Sequence[str]) -> str:
    """A list literal as ruff formats it in a class."""
    literals: List[str] = [json.dumps(name) for name in names]
    line = f"[{', '.join(literals)}]"
    if len("    parameters = ") + len(line) <= WIDTH:
        return line
    return "[\n" + "".join(f"        {literal},\n" for literal in literals) + "    ]"

# SPDX-License-Identifier: Apache-2.0
"""The mutation check: what it changes, which tests it runs, and that only a copy is changed."""

import argparse
import ast
from pathlib import Path

import pytest
from mutants.changes import mutants
from mutants.importers import Imports
from mutants.measurement import Table, measure, selected
from mutants.trial import HUNG, KILLED, Bench

GATE = """def is_open(pressure: float) -> bool:
    return pressure <= 3.0
"""
STRICT_TEST = """from robot.gate import is_open

def test_the_limit_itself():
    assert is_open(3.0) and not is_open(3.5) and not is_open(4.0)
"""
LAX_TEST = """from robot import gate

def test_it_can_be_asked():
    gate.is_open(1.0)
"""


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A workspace with one package, whose name no package of MERLIN has."""
    write(tmp_path, "src/robot/src/robot/__init__.py", "")
    write(tmp_path, "src/robot/src/robot/gate.py", GATE)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "src/robot/src"))
    return tmp_path


def write(root: Path, name: str, text: str) -> Path:
    path = root / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def measured(root: Path, folder: Path) -> Table:
    modules = selected(["robot/*"], root)
    table = Table(modules, root)
    options = argparse.Namespace(sample=20, seed=1, seconds=60.0, minutes=0.0)
    measure(modules, table, Bench(folder, root), options, root)
    return table


def test_tests_that_check_the_limit_let_nothing_survive_and_only_a_copy_is_changed(
    root: Path, tmp_path: Path
) -> None:
    write(root, "test/unit/robot/test_gate.py", STRICT_TEST)
    before = {path: path.read_bytes() for path in root.glob("src/**/*.py")}
    (ends,) = measured(root, tmp_path / "copy").ends.values()
    assert ends and {end for _, end, _ in ends} == {KILLED}
    assert {path: path.read_bytes() for path in root.glob("src/**/*.py")} == before
    assert (tmp_path / "copy/robot/gate.py").read_text() == GATE


@pytest.mark.long
def test_a_test_that_asserts_nothing_lets_changes_survive(root: Path, tmp_path: Path) -> None:
    write(root, "test/unit/robot/test_gate.py", LAX_TEST)
    table = measured(root, tmp_path / "copy")
    assert {mutant.after for mutant in table.survivors()} >= {"return None"}
    lines = list(table.lines())
    count = len(table.survivors())
    assert f"| robot/gate.py | {count} | 0 | {count} | 100% |" in lines
    assert "robot/gate.py:2: return pressure <= 3.0  ->  return None" in lines


@pytest.mark.long
def test_a_module_without_a_test_file_lets_all_survive(root: Path, tmp_path: Path) -> None:
    table = measured(root, tmp_path / "copy")
    (ends,) = table.ends.values()
    assert table.survivors() == [mutant for mutant, _, _ in ends] != []


@pytest.mark.long
def test_a_change_that_never_ends_counts_as_noticed(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    gate = write(root, "src/robot/src/robot/gate.py", GATE)
    test = write(root, "test/unit/robot/test_gate.py", STRICT_TEST)
    bench = Bench(tmp_path / "copy", root)
    assert bench.chosen([test], 60.0) == [test]
    endless = mutants(gate, 1, 1, root)[0]._replace(text="while True: pass\n")
    monkeypatch.setattr("mutants.trial.GRACE", 1.0)
    assert bench.run(endless, [test])[0] == HUNG


def test_the_same_seed_draws_the_same_changes(root: Path) -> None:
    gate = root / "src/robot/src/robot/gate.py"
    assert mutants(gate, 2, 5, root) == mutants(gate, 2, 5, root)
    assert len(mutants(gate, 2, 5, root)) == 2


def test_every_change_is_valid_python_with_another_meaning(root: Path) -> None:
    text = "def f(a, *, b: int = 2):\n    if a and not b:\n        b.c = a\n        print(a)\n    return b\n"
    module = write(root, "src/robot/src/robot/more.py", text)
    made = mutants(module, 99, 1, root)
    assert all(ast.dump(ast.parse(mutant.text)) != ast.dump(ast.parse(text)) for mutant in made)
    assert {"b.c = a", "print(a)", "return b"} <= {mutant.before for mutant in made}


def test_the_nearest_importers_come_first(root: Path) -> None:
    write(root, "src/robot/src/robot/base.py", "from robot.gate import is_open\n")
    write(root, "test/unit/robot/held_world.py", "import robot.base\n")
    near = write(root, "test/unit/robot/test_other.py", "from robot import gate\n")
    far = write(root, "test/unit/robot/test_base.py", "from robot.base import is_open\n")
    farther = write(root, "test/unit/robot/test_world.py", "from held_world import base\n")
    write(root, "test/unit/robot/test_unrelated.py", "import math\n")
    assert Imports(root).tests_of(root / "src/robot/src/robot/gate.py") == [near, far, farther]


@pytest.mark.long
def test_tests_that_fail_without_a_change_are_left_out(root: Path, tmp_path: Path) -> None:
    red = write(root, "test/unit/robot/test_red.py", "def test_red():\n    assert False\n")
    green = write(root, "test/unit/robot/test_gate.py", STRICT_TEST)
    assert Bench(tmp_path / "copy", root).chosen([red, green], 60.0) == [green]

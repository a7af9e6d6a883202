# SPDX-License-Identifier: Apache-2.0
"""The check of tests finds those that assert nothing, and no others."""

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

TOOL = Path(__file__).resolve().parents[2] / "tools" / "check_tests.py"


@pytest.fixture
def tool(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    spec = importlib.util.spec_from_file_location("check_tests", TOOL)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(module, "ROOT", tmp_path)
    return module


def write(root: Path, **files: str) -> None:
    """Writes modules of the test tree; ``__`` in a name separates folders."""
    for name, text in files.items():
        path = root / "test" / f"{name.replace('__', '/')}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


@pytest.mark.parametrize(
    "body",
    [
        "assert x",
        "with pytest.raises(OSError): x()",
        "if x: raise AssertionError(x)",
        "self.assertEqual(x, 1)",
        "mock.assert_called_once()",
        "pytest.fail()",
        "run_state_machine_as_test(Machine)",
    ],
)
def test_a_test_that_asserts_passes(tool: ModuleType, tmp_path: Path, body: str) -> None:
    write(tmp_path, unit__test_a=f"def test_it():\n    {body}\n")
    write(tmp_path, rostest__b_cases=f"class Cases:\n    def test_it(self):\n        {body}\n")
    assert tool.main() == 0


def test_what_helpers_assert_counts(tool: ModuleType, tmp_path: Path) -> None:
    write(
        tmp_path,
        conftest="class Node:\n    def expect(self):\n        assert 1\n",
        unit__one__inner="def check():\n    assert 1\n",
        unit__one__outer="from inner import check\ndef look():\n    check()\n",
        unit__one__test_a="from outer import look\ndef test_it(): look()\n",
        unit__one__test_b="def test_it(node): node.expect()\n",
    )
    assert tool.main() == 0


@pytest.mark.parametrize(
    "text",
    [
        "def test_it():\n    run()\n",
        "def test_it():\n    fail_next()\n",
        "class TestAll:\n    def test_it(self):\n        self.run()\n",
        "from helper import start\ndef test_it():\n    start()\n",
        "def again():\n    again()\ndef test_it():\n    again()\n",
        "def check():\n    assert 1\ndef test_it():\n    stop()\n",
    ],
)
@pytest.mark.parametrize("name", ["unit__test_a", "rostest__a_test", "rostest__a_cases"])
def test_a_test_that_asserts_nothing_is_named(
    tool: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture, name: str, text: str
) -> None:
    write(tmp_path, **{name: text, "unit__helper": "def start():\n    run()\ndef stop():\n    assert 1\n"})
    assert tool.main() == 1
    assert capsys.readouterr().err.endswith(": test_it asserts nothing\n")


def test_what_is_no_test_may_assert_nothing(tool: ModuleType, tmp_path: Path) -> None:
    write(
        tmp_path,
        unit__test_a="@pytest.fixture\ndef test_folder(): ...\ndef start(): ...\n",
        unit__world="def test_it(): ...\n",
    )
    assert tool.main() == 0

# SPDX-License-Identifier: Apache-2.0
"""The tool behind `make imports`: what cannot be imported is named."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "tools"))

import import_all


def test_a_module_that_cannot_be_imported_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    package = tmp_path / "built_for_this_test"
    package.mkdir()
    modules = {"__init__": "", "good": "", "needs": "import not_to_be_had_here", "newer": "match = ("}
    modules["tests"] = "raise ModuleNotFoundError('no pytest', name='pytest')"
    for name, text in modules.items():
        (package / f"{name}.py").write_text(text, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(import_all, "BUILT", tmp_path)
    monkeypatch.setattr(import_all, "ROOT", tmp_path)
    assert import_all.main() == 1
    *named, last = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in named] == [f"{package.name}.needs", f"{package.name}.newer"]
    assert last.endswith("5 modules and scripts, 2 fail")

# SPDX-License-Identifier: Apache-2.0
"""Which pins `make pins` asks for, and what it makes of the answers; pip is stood in for."""

import sys
from pathlib import Path
from typing import List

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "tools"))

import pins

LINES = ["# --- planner ---", 'kairos-planner==1.0.6; python_version >= "3.10"', "", "rdflib==7.6.0"]


@pytest.mark.parametrize(
    ("python", "names"),
    [("3.9", ["rdflib==7.6.0"]), ("3.10", ["kairos-planner==1.0.6", "rdflib==7.6.0"])],
)
def test_a_marker_is_read_for_the_python_that_is_asked_about(python: str, names: List[str]) -> None:
    assert pins.wanted(LINES, python, "aarch64") == names


def test_a_package_of_which_no_pin_holds_is_left_out() -> None:
    lines = [*LINES, 'x==2; python_version >= "3.10"', 'x==1; python_version < "3.10"']
    assert pins.left_out(lines, "3.9", "x86_64") == ["kairos-planner"]
    assert pins.left_out(lines, "3.10", "x86_64") == []


class Index:
    """pip, for which some pins have no wheel."""

    def __init__(self, lacks: str, monkeypatch: pytest.MonkeyPatch) -> None:
        self.asked: List[List[str]] = []
        self._run = pins._run
        self._lacks = lacks
        monkeypatch.setattr(pins, "_run", self)

    def __call__(self, command: List[str]) -> object:
        if command[0].startswith("tools/"):
            return self._run(command)
        self.asked.append(command)
        found = not any(self._lacks in word for word in command)
        return pins.subprocess.CompletedProcess(command, 0 if found else 1, "", "")


def test_the_pin_without_a_wheel_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    Index("pyastar2d", monkeypatch)
    assert [pin[:9] for pin in pins.missing(pins.PLATFORMS[0], "x86_64", "robot")] == ["pyastar2d"]


def test_wheels_for_an_older_glibc_are_asked_for_and_none_for_a_newer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    index = Index("nothing", monkeypatch)
    assert pins.missing(pins.PLATFORMS[0], "aarch64", "robot") == []
    assert "--platform=manylinux_2_17_aarch64" in index.asked[0]
    assert "--platform=manylinux_2_31_aarch64" in index.asked[0]
    assert "--platform=manylinux_2_34_aarch64" not in index.asked[0]


def test_an_index_that_does_not_answer_is_no_missing_pin(monkeypatch: pytest.MonkeyPatch) -> None:
    Index("==", monkeypatch)
    monkeypatch.setattr(pins, "ALWAYS", "packaging==1")
    with pytest.raises(pins.IndexSilent, match="does not answer"):
        pins.missing(pins.PLATFORMS[0], "x86_64", "robot")


PAGE = f"# Page\n{pins.BEGIN}| old |\n{pins.END}the rest\n"


def run(page: Path, monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr(pins, "PAGE", page)
    monkeypatch.setattr(sys, "argv", ["pins", *arguments])
    return pins.main()


def test_a_table_that_is_no_longer_true_is_reported_and_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    page = tmp_path / "platforms.md"
    page.write_text(PAGE, encoding="utf-8")
    Index("pyastar2d", monkeypatch)
    assert run(page, monkeypatch) == 1 and "make pins DOCS=1" in capsys.readouterr().err
    assert run(page, monkeypatch, "--docs") == 0
    written = page.read_text(encoding="utf-8")
    assert "| 3.8 | Ubuntu 20.04 | no wheel of pyastar2d==" in written and "| old |" not in written
    assert written.startswith("# Page\n") and written.endswith("the rest\n")
    assert run(page, monkeypatch) == 0


@pytest.mark.parametrize("processor", pins.PROCESSORS)
@pytest.mark.parametrize("platform", pins.PLATFORMS, ids=lambda platform: platform.python)
def test_each_python_gets_one_version_of_each(platform: pins.Platform, processor: str) -> None:
    lines = (pins.ROOT / "requirements-nodeps.txt").read_text(encoding="utf-8").splitlines()
    names = [pin.split("==")[0] for pin in pins.wanted(lines, platform.python, processor)]
    assert names.count("pyastar2d") == 1
    newest = platform.python in ("3.11", "3.13")
    assert names.count("pocketsphinx") == (1 if processor == "x86_64" or newest else 0)

# SPDX-License-Identifier: Apache-2.0
"""An application's modules are read anew as a whole, or stay as they were."""

import os
import sys
from pathlib import Path

import pytest

from merlin_actions.core.application_modules import ApplicationModules


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package of two modules, of which one takes a constant of the other."""
    folder = tmp_path / "hospital_courier"
    folder.mkdir()
    (folder / "__init__.py").write_text("")
    (folder / "words.py").write_text('HELLO = "hello"\n')
    (folder / "greet.py").write_text(
        "import colorsys\n"
        "from hospital_courier.words import HELLO\n"
        "class Greet:\n"
        "    def say(self):\n"
        "        return HELLO\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "dont_write_bytecode", False)  # as a robot runs
    yield folder
    for name in [name for name in sys.modules if name.partition(".")[0] == "hospital_courier"]:
        del sys.modules[name]


def loaded() -> type:
    from hospital_courier.greet import Greet

    return Greet


def noted() -> ApplicationModules:
    modules = ApplicationModules()
    loaded()
    modules.note()
    return modules


def test_a_constant_of_another_module_is_read_anew(package: Path) -> None:
    modules = noted()
    old, library = loaded()(), sys.modules["colorsys"]
    assert modules.edited() == []
    (package / "words.py").write_text('HELLO = "good morning"\n')
    assert modules.edited() == ["hospital_courier.words"]
    with modules.renewed():
        new = loaded()()
    modules.note()
    assert (old.say(), new.say()) == ("hello", "good morning")
    assert loaded()().say() == "good morning" and modules.edited() == []
    assert sys.modules["colorsys"] is library


def test_an_edit_of_the_same_length_within_a_second_is_read(package: Path) -> None:
    words = package / "words.py"
    os.utime(str(words), ns=(10**18, 10**18))
    modules = noted()
    words.write_text('HELLO = "salut"\n')
    os.utime(str(words), ns=(10**18 + 1, 10**18 + 1))
    assert modules.edited() == ["hospital_courier.words"]
    with modules.renewed():
        assert loaded()().say() == "salut"


def test_before_anything_is_noted_nothing_counts_as_edited(package: Path) -> None:
    modules = ApplicationModules()
    assert modules.edited() == []
    loaded()
    assert modules.edited() == []


def test_after_an_error_all_is_as_before(package: Path) -> None:
    modules = noted()
    old = loaded()
    (package / "words.py").write_text('HELLO = "good morning"\n')
    (package / "greet.py").write_text("def broken(:\n")
    with pytest.raises(SyntaxError), modules.renewed():
        loaded()
    assert loaded() is old and old().say() == "hello"
    import hospital_courier

    assert hospital_courier.words.HELLO == "hello"
    assert modules.edited() == ["hospital_courier.greet", "hospital_courier.words"]


def test_what_the_process_had_before_stays(package: Path) -> None:
    import hospital_courier.words as words

    modules = noted()
    (package / "words.py").write_text('HELLO = "good morning"\n')
    with modules.renewed():
        assert loaded()().say() == "hello"
    assert sys.modules["hospital_courier.words"] is words


def test_a_module_of_a_package_that_the_process_had_before_is_read_anew(package: Path) -> None:
    import hospital_courier

    modules = ApplicationModules()
    from hospital_courier import words as old

    modules.note()
    (package / "words.py").write_text('HELLO = "good morning"\n')
    with modules.renewed():
        from hospital_courier import words as new
    assert (old.HELLO, new.HELLO) == ("hello", "good morning")
    assert hospital_courier.words is new


def test_generated_messages_are_not_edits(package: Path) -> None:
    (package / "msg").mkdir()
    (package / "msg" / "__init__.py").write_text("from hospital_courier.msg._Order import *\n")
    (package / "msg" / "_Order.py").write_text("FIELDS = 1\n")
    modules = ApplicationModules()
    import hospital_courier.msg

    loaded()
    modules.note()
    (package / "msg" / "_Order.py").write_text("FIELDS = 2\n")
    assert modules.edited() == [] and hospital_courier.msg.FIELDS == 1
    (package / "words.py").write_text('HELLO = "good morning"\n')
    assert modules.edited() == ["hospital_courier.words"]

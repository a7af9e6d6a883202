# SPDX-License-Identifier: Apache-2.0
"""docs/states.md is what the state classes say, of every registered state and of each argument."""

import contextlib
import importlib.util
import inspect
from pathlib import Path
from typing import Iterator

import pytest

from merlin_sm.state_factory import MerlinStateFactory
from merlin_sm.states.merlin_state import MerlinState

ROOT = Path(__file__).resolve().parents[3]
_spec = importlib.util.spec_from_file_location("state_reference", ROOT / "tools" / "state_reference.py")
reference = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(reference)


class Mumble(MerlinState):
    """Says something.

    :param text: it.
    """

    __module__ = "merlin_sm.states.mumble"

    def __init__(self, text: str, quickly: bool = False) -> None:
        super().__init__(output_keys=["mumbled"])


def test_the_page_is_up_to_date() -> None:
    assert reference.page() == reference.PAGE.read_text(encoding="utf-8"), (
        "run: tools/in_workspace.sh python tools/state_reference.py"
    )


class TakenBack(Exception):
    """Leaves the factory as it was."""


@pytest.fixture
def mumble() -> Iterator[None]:
    """There is a state of this name."""
    with contextlib.suppress(TakenBack), MerlinStateFactory.renewed():
        MerlinStateFactory.register("mumble", Mumble)
        yield
        raise TakenBack


@pytest.mark.usefixtures("mumble")
def test_a_new_state_has_to_be_entered() -> None:
    with pytest.raises(ValueError, match="mumble"):
        reference.page()


@pytest.mark.usefixtures("mumble")
def test_each_argument_has_to_be_described(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(reference.WRITTEN, "mumble", ('state("mumble", "hm")',))
    with pytest.raises(ValueError, match="nothing about the argument 'quickly'"):
        reference.section("mumble")
    Mumble.__doc__ = f"{inspect.getdoc(Mumble)}\n:param quickly: or slowly.\n"
    assert '| `state("mumble", "hm")` | – | `mumbled` | – |' in reference.section("mumble")

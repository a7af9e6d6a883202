# SPDX-License-Identifier: Apache-2.0
"""An action that is a behaviour tree is checked, and ends, as one that is a machine."""

from typing import Any

import pytest
from py_trees.behaviours import Failure
from py_trees.composites import Selector, Sequence

from merlin_actions.action_classes import make_machines
from merlin_actions.core.application_check import ApplicationError
from merlin_actions.core.ending import GIVEN_UP, NOT_BEGUN
from merlin_actions.machine_survey import survey
from merlin_actions.merlin_action_bt import MerlinActionBT
from merlin_actions.merlin_action_server import given_up
from merlin_sm.states.merlin_state import GivenUp


class Fetch(MerlinActionBT):
    """Drives, looks and says what it sees; speaks of what nothing has set."""

    parameters = ["from", "to"]

    def tree(self) -> Any:
        drive = self.behaviour("DRIVE", self.state("navigation"), remapping={"target": "from"})
        see = self.behaviour("SEE", self.state("recognize"), remapping={"detections": "seen"})
        look = Sequence("LOOK", memory=True, children=[see])
        note = self.behaviour("NOTE", self.state("function", lambda _: None, ["seen", "to"]))
        tell = self.behaviour("TELL", self.state("speak", "{what} is there."))
        ready = self.behaviour("READY", self.state("navigation", "kitchen"))
        return Sequence("FETCH", memory=True, children=[drive, look, note, tell, ready])


class Hopeless(MerlinActionBT):
    """Gives up, as the last that is tried."""

    parameters = ["p"]
    tried: tuple = ()

    def tree(self) -> Any:
        drive = self.behaviour("DRIVE", self.state("function", self._drive, ["p"]))
        return Selector("ANY", memory=True, children=[*(Failure(name) for name in self.tried), drive])

    def _drive(self, userdata: Any) -> None:
        raise GivenUp(f"there is no {userdata.p}", about=userdata.p)


class HopelessAtLast(Hopeless):
    """After something that may have done more than it says."""

    tried = ("OTHER",)


class WithoutTree(MerlinActionBT):
    """Forgot to return it."""

    def tree(self) -> Any:
        self.behaviour("DRIVE", self.state("navigation"))


def test_the_check_finds_what_a_tree_needs(monkeypatch: pytest.MonkeyPatch) -> None:
    needs = survey(Fetch())
    assert needs.targets == ("from",)
    assert needs.points == ("kitchen",)
    assert ("FETCH/LOOK/SEE", "recognize") in needs.servers
    (unset,) = needs.unset
    assert unset.startswith(
        "state FETCH/TELL reads userdata 'what', which nothing sets; there is: from, seen"
    )


@pytest.mark.parametrize(("action", "how"), [(Hopeless, NOT_BEGUN), (HopelessAtLast, GIVEN_UP)])
def test_a_tree_gives_up_as_a_machine_does(action: type, how: str) -> None:
    machine = action()
    assert machine.run_once({"p": "attic"}) == "aborted"
    assert machine.reason == "there is no attic"
    assert given_up(machine) == how
    assert machine.about == "attic"


def test_a_class_without_a_tree_is_refused() -> None:
    with pytest.raises(
        ApplicationError, match="the root of a tree has to be a behaviour of py_trees, not None"
    ):
        make_machines([f"{__name__}:WithoutTree"])

# SPDX-License-Identifier: Apache-2.0
"""The operators of the domain as state machines, each of one ready state."""

from typing import Sequence

from merlin_actions.merlin_action_sm import MerlinActionSM

CANCEL_LIMIT = 2.5  # s: pyrobosim does not interrupt the planning of a path


class OneState(MerlinActionSM):
    """Runs a ready state with the operator's objects."""

    ready: Sequence[str] = ()
    """Its name and arguments."""

    def build(self) -> None:
        """One state."""
        self.add("ACT", self.state(*self.ready))


class Navigate(MerlinActionSM):
    """Drives to a spot or a door."""

    parameters = ["from", "to", "r"]

    def build(self) -> None:
        """One state."""
        self.add("DRIVE", self.state("navigation", cancel_limit=CANCEL_LIMIT), remapping={"target": "to"})


class Charge(Navigate):
    """Drives to a charger, which fills the battery when the robot arrives."""


class Open(OneState):
    """Opens the container at which the robot is."""

    parameters, ready = ["s"], ("open", "{s}")


class OpenDoor(OneState):
    """Opens the door at which the robot is."""

    parameters, ready = ["d", "a", "b"], ("open", "{d}")


class Close(OneState):
    """Closes the container at which the robot is."""

    parameters, ready = ["s"], ("close", "{s}")


class Pick(OneState):
    """Picks a thing up."""

    parameters, ready = ["o", "s"], ("pick", "{o}", "{s}")


class Place(OneState):
    """Puts the thing in the hand down."""

    parameters, ready = ["o", "s"], ("place", "{o}", "{s}")


class Detect(MerlinActionSM):
    """Looks at all that is at a spot. Fails when the wanted thing is not there; what it saw is known."""

    parameters = ["o", "s"]

    def build(self) -> None:
        """One state."""
        self.add("LOOK", self.state("detect", "{o}", "{s}"), {"not_found": "aborted"})

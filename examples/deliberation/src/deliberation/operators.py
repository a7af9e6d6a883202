# SPDX-License-Identifier: Apache-2.0
"""The operators of the domain as state machines: each does one action of the simulated robot."""

from typing import Any

from diagnostic_msgs.msg import KeyValue
from merlin_msgs.msg import RunActionAction, RunActionGoal

from merlin_actions.merlin_action_sm import MerlinActionSM

CANCEL_LIMIT = 2.5  # s: pyrobosim does not interrupt the planning of a path


class OnRobot(MerlinActionSM):
    """Runs an action of the robot on one of the operator's objects."""

    action = ""
    """Of pyrobosim."""
    target = ""
    """The variable of the object; empty: the action has none."""

    def build(self) -> None:
        """One state: the robot's action."""
        state = self.state(
            "action",
            f"pyrobosim/{self.action}",
            RunActionAction,
            self._goal,
            input_keys=[self.target] if self.target else [],
            cancel_limit=CANCEL_LIMIT,
        )
        self.add("ACT", state)

    def _goal(self, userdata: Any) -> RunActionGoal:
        named = [KeyValue("target", userdata[self.target])] if self.target else []
        return RunActionGoal(parameters=named)


class Navigate(OnRobot):
    """Drives to a spot or a door."""

    parameters = ["from", "to", "r"]
    action, target = "navigate", "to"


class Charge(Navigate):
    """Drives to a charger, which fills the battery when the robot arrives."""


class Open(OnRobot):
    """Opens the container at which the robot is."""

    parameters = ["s"]
    action = "open"


class OpenDoor(OnRobot):
    """Opens the door at which the robot is."""

    parameters = ["d", "a", "b"]
    action = "open"


class Close(OnRobot):
    """Closes the container at which the robot is."""

    parameters = ["s"]
    action = "close"


class Detect(OnRobot):
    """Looks at all that is at a spot. Fails when the wanted thing is not there; what it saw is known."""

    parameters = ["o", "s"]
    action, target = "detect", "o"


class Pick(OnRobot):
    """Picks a thing up."""

    parameters = ["o", "s"]
    action, target = "pick", "o"


class Place(OnRobot):
    """Puts the thing in the hand down."""

    parameters = ["o", "s"]
    action, target = "place", "o"

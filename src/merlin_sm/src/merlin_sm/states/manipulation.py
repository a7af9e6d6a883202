# SPDX-License-Identifier: Apache-2.0
"""What an arm does with an object: pick, place, open, close."""

from typing import Any, Sequence

from geometry_msgs.msg import PoseStamped
from merlin_msgs.msg import ManipulateAction, ManipulateGoal

from merlin_sm.states.action_state import ActionState
from merlin_sm.states.recognition import Recognized
from merlin_sm.states.text_keys import filled, keys_of


class ManipulateState(ActionState):
    """Base of what an arm does.

    :cvar does: name of its action.
    :param name: of the object, or of what it opens; ``{key}`` is replaced by the userdata of that name.
    :param place: name of where that is, or goes, likewise; empty: where the robot stands.
    :param seen: key of the userdata that ``detect`` or ``recognize`` has set: the best pose of the object
        goes with the goal. Empty: the server finds the object.
    :param action: name of the merlin_msgs/Manipulate action; empty: the name of the state.
    """

    does = ""

    def __init__(self, name: str, place: str = "", seen: str = "", action: str = "", **options: Any) -> None:
        def goal(userdata: Any) -> ManipulateGoal:
            wanted = filled(name, userdata)
            if not wanted.strip():
                raise ValueError(f"{self.action} has no object; its name is empty")
            pose = _pose(wanted, userdata[seen]) if seen else PoseStamped()
            return ManipulateGoal(object=wanted, place=filled(place, userdata), pose=pose)

        inputs = [*keys_of([name, place]), *([seen] if seen else [])]
        super().__init__(action or self.does, ManipulateAction, goal, input_keys=inputs, **options)


class PickState(ManipulateState):
    """Has the arm pick an object up."""

    does = "pick"


class PlaceState(ManipulateState):
    """Has the arm put an object down."""

    does = "place"


class OpenState(ManipulateState):
    """Has the arm open a door or a container."""

    does = "open"


class CloseState(ManipulateState):
    """Has the arm close a door or a container."""

    does = "close"


def _pose(name: str, seen: Sequence[Recognized]) -> PoseStamped:
    found = [item for item in seen if item.name == name]
    if not found:
        raise ValueError(f"{name} is not among what was seen; look for it first")
    best = max(found, key=lambda item: item.score).detection
    return PoseStamped(best.header, best.results[0].pose.pose)

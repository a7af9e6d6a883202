# SPDX-License-Identifier: Apache-2.0
"""The actions of the campaign's domain: three that behave, three that do not, and one of plain actionlib."""

from typing import Any

import actionlib
import rospy
from actionlib_msgs.msg import GoalStatus
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal

from merlin_actions.actions.navigate import Navigate
from merlin_actions.merlin_action_sm import MerlinActionSM
from merlin_sm.states.function_state import FunctionState
from merlin_sm.states.merlin_state import PREEMPTED, SUCCEEDED, MerlinState
from merlin_sm.states.navigation import NavigationState, point_of_interest
from merlin_sm.states.speech import ListenState

SENTENCE = "I say this so that it can be interrupted."
GRAMMAR = "#JSGF V1.0; grammar answer; public <answer> = yes | no;"
LISTENING = 4.0  # s
LONGEST_DRIVE = 600.0  # s


class Say(MerlinActionSM):
    """Says a sentence."""

    parameters = ["n"]

    def build(self) -> None:
        """One state."""
        self.add("SPEAK", self.state("speak", text=SENTENCE))


class Hear(MerlinActionSM):
    """Listens for a while; nothing is ever said."""

    parameters = ["n"]

    def build(self) -> None:
        """One state; hearing nothing is what it expects."""
        self.add("LISTEN", ListenState(GRAMMAR, LISTENING), transitions={"misunderstood": "succeeded"})


class DeafState(NavigationState):
    """Does not listen to a preempt."""

    def request_preempt(self) -> None:
        """Does nothing."""

    def preempt_requested(self) -> bool:
        """Never."""
        return False


class TouchyState(NavigationState):
    """Raises when it is preempted."""

    def request_preempt(self) -> None:
        """Raises."""
        raise RuntimeError("this state does not like to be preempted")


class DriveDeaf(MerlinActionSM):
    """Drives, whatever the client wants."""

    parameters = ["from", "to"]
    if_interrupted = Navigate.if_interrupted

    def build(self) -> None:
        """One state."""
        self.add("DRIVE", DeafState(), remapping={"target": "to"})


class DriveTouchy(MerlinActionSM):
    """Drives, and raises when it is cancelled."""

    parameters = ["from", "to"]
    if_interrupted = Navigate.if_interrupted

    def build(self) -> None:
        """One state."""
        self.add("DRIVE", TouchyState(), remapping={"target": "to"})


class PlainDriveState(MerlinState):
    """Drives with actionlib's own client, as an application does that knows no other."""

    def __init__(self) -> None:
        super().__init__(input_keys=["target"])
        self._client = actionlib.SimpleActionClient("move_base", MoveBaseAction)

    def run(self, userdata: Any) -> str:
        """Drives to the point of interest `target`."""
        self._client.send_goal(MoveBaseGoal(target_pose=point_of_interest(userdata.target)))
        self.interruptible(self._client.cancel_goal)
        ended = self._client.wait_for_result(rospy.Duration(LONGEST_DRIVE))
        self.interruptible(None)
        status, text = self._client.get_state(), self._client.get_goal_status_text()
        if ended and status == GoalStatus.SUCCEEDED:
            return SUCCEEDED
        if self.preempt_requested():
            return PREEMPTED
        return self.fail(f"move_base ended the plain drive as {GoalStatus.to_string(status)}: {text}")


class DrivePlain(MerlinActionSM):
    """Drives with a client that knows no lease, in a node whose other actions have MERLIN's."""

    parameters = ["from", "to"]
    if_interrupted = Navigate.if_interrupted

    def build(self) -> None:
        """One state."""
        self.add("DRIVE", PlainDriveState(), remapping={"target": "to"})


class Quit(MerlinActionSM):
    """Ends its thread."""

    parameters = ["n"]

    def build(self) -> None:
        """One state."""
        self.add("QUIT", FunctionState(self._quit))

    def _quit(self, userdata: object) -> None:
        rospy.loginfo("leaving")
        raise SystemExit(3)

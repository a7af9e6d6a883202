"""The actions of the campaign's domain: three that behave, three that do not."""

import rospy

from merlin_actions.actions.navigate import Navigate
from merlin_actions.merlin_action_sm import MerlinActionSM
from merlin_sm.states.function_state import FunctionState
from merlin_sm.states.navigation import NavigationState
from merlin_sm.states.speech import ListenState

SENTENCE = "I say this so that it can be interrupted."
GRAMMAR = "#JSGF V1.0; grammar answer; public <answer> = yes | no;"
LISTENING = 4.0  # s


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


class Quit(MerlinActionSM):
    """Ends its thread."""

    parameters = ["n"]

    def build(self) -> None:
        """One state."""
        self.add("QUIT", FunctionState(self._quit))

    def _quit(self, userdata: object) -> None:
        rospy.loginfo("leaving")
        raise SystemExit(3)

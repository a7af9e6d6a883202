"""MerlinSM: a SMACH state machine that knows the planning system (paper, Figure 2)."""

from typing import Any, List, Sequence

import rospy

from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant
from smach import StateMachine


class MerlinSM(StateMachine, MerlinROSPlanAssistant):
    """SMACH's state machine plus the knowledge functions of :class:`MerlinROSPlanAssistant`.

    Parameters are those of :class:`smach.StateMachine`.

    After a run, :attr:`reason` is the sentence that the last state left (states of MERLIN have a ``reason``),
    also out of nested machines. A state that is aborted is logged with its reason, wherever its transition
    leads: a machine that goes on after a failure does not hide it.
    """

    def __init__(
        self, outcomes: Sequence[str], input_keys: Sequence[str] = (), output_keys: Sequence[str] = ()
    ) -> None:
        super().__init__(list(outcomes), list(input_keys), list(output_keys))
        self.reason = ""
        self._cancelled = False
        self._at: List[str] = []  # labels of the states that run
        self.register_start_cb(self.__begin)  # a name that subclasses, users' code, do not override by chance
        self.register_transition_cb(self.__left)
        self.register_termination_cb(self._take_reason)

    def prepare(self) -> None:
        """Forgets the cancels of earlier runs. A caller of :meth:`cancel` calls this before each run."""
        self._cancelled = False

    def cancel(self) -> None:
        """Preempts the run; unlike ``request_preempt()`` also one that is prepared and has not begun."""
        self._cancelled = True
        self.request_preempt()

    def __begin(self, userdata: Any, initial_states: List[str]) -> None:
        self.reason = ""
        self._at = list(initial_states)
        if self._cancelled:
            # SMACH forgets the flag of an idle machine when a run begins. request_preempt() would deadlock in
            # a callback of the original SMACH, so the flag it sets is set here.
            self._preempt_requested = True

    def __left(self, userdata: Any, active_states: List[str]) -> None:
        for label in self._at:
            state = self.get_children().get(label)
            if getattr(state, "outcome", "") == "aborted":
                rospy.loginfo(f"{label} was aborted: {getattr(state, 'reason', '') or 'no reason is known'}")
        self._at = list(active_states)

    def _take_reason(self, userdata: Any, terminal_states: List[str], outcome: str) -> None:
        children = self.get_children()
        reasons = [getattr(children[label], "reason", "") for label in terminal_states if label in children]
        self.reason = "; ".join(filter(None, reasons))

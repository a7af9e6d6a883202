"""MerlinSM: a SMACH state machine that knows the planning system (paper, Figure 2)."""

from typing import Any, List, Sequence

from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant
from smach import StateMachine


class MerlinSM(StateMachine, MerlinROSPlanAssistant):
    """SMACH's state machine plus the knowledge functions of :class:`MerlinROSPlanAssistant`.

    Parameters are those of :class:`smach.StateMachine`.

    After a run, :attr:`reason` is the sentence that the last state left (states of MERLIN have a ``reason``),
    also out of nested machines.
    """

    def __init__(
        self, outcomes: Sequence[str], input_keys: Sequence[str] = (), output_keys: Sequence[str] = ()
    ) -> None:
        super().__init__(list(outcomes), list(input_keys), list(output_keys))
        self.reason = ""
        self.register_start_cb(self._forget_reason)
        self.register_termination_cb(self._take_reason)

    def _forget_reason(self, userdata: Any, initial_states: List[str]) -> None:
        self.reason = ""

    def _take_reason(self, userdata: Any, terminal_states: List[str], outcome: str) -> None:
        children = self.get_children()
        reasons = [getattr(children[label], "reason", "") for label in terminal_states if label in children]
        self.reason = "; ".join(filter(None, reasons))

# SPDX-License-Identifier: Apache-2.0
"""MerlinSM: a SMACH state machine that knows the planning system (paper, Figure 2)."""

from typing import Any, Iterable, List, Mapping, Optional, Sequence

import rospy

from merlin_sm.autonomy import label_text, read_levels
from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant
from merlin_sm.userdata_keys import check_lists
from smach import Container, State, StateMachine


class MerlinSM(StateMachine, MerlinROSPlanAssistant):
    """SMACH's state machine plus the knowledge functions of :class:`MerlinROSPlanAssistant`.

    Parameters are those of :class:`smach.StateMachine`.

    After a run, :attr:`reason` is the sentence that the last state left (states of MERLIN have a ``reason``),
    also out of nested machines and of SMACH's own containers. A state that is aborted is logged with its
    reason, wherever its transition leads: a machine that continues after a failure does not hide it.
    :attr:`given_up` and :attr:`about` come from the last state, too.

    Each run begins clean: what an earlier one left in the userdata is gone.
    """

    keeps_userdata = False

    def __init__(
        self, outcomes: Sequence[str], input_keys: Sequence[str] = (), output_keys: Sequence[str] = ()
    ) -> None:
        check_lists(outcomes=outcomes, input_keys=input_keys, output_keys=output_keys)
        super().__init__(list(outcomes), list(input_keys), list(output_keys))
        self.reason = self.about = ""
        self.given_up = self._cancelled = False
        self._at: List[str] = []  # labels of the states that run
        self.register_start_cb(self.__begin)  # a name that subclasses, users' code, do not override by chance
        self.register_transition_cb(self.__left)
        self.register_termination_cb(_take_reason, [self])

    def close(self) -> None:
        """Ends the construction.

        :raises smach.SmachError: the machine is not complete or contradicts itself. SMACH only logs that, and
            a robot would learn of it when it runs the machine.
        """
        super().close()
        self.check_consistency()
        _follow_reasons(self)

    @staticmethod
    def add(
        label: str, state: State, *args: Any, autonomy: Optional[Mapping[str, str]] = None, **options: Any
    ) -> State:
        """Adds a state to the open machine as ``smach.StateMachine.add`` does, and notes its remapping.

        :param autonomy: outcome → level that it requires, ``low``, ``high`` or ``full``: where the level of
            the node is lower, the outcome is not taken before an operator confirms it.
        :raises ValueError: the state has no such outcome, or there is no such level.
        """
        _note(state, args[1:], options, label, autonomy)
        return StateMachine.add(label, state, *args, **options)

    @staticmethod
    def add_auto(
        label: str, state: State, *args: Any, autonomy: Optional[Mapping[str, str]] = None, **options: Any
    ) -> State:
        """Adds a state as ``smach.StateMachine.add_auto`` does; `autonomy` as for :meth:`add`."""
        _note(state, args[2:], options, label, autonomy)
        return StateMachine.add_auto(label, state, *args, **options)

    def prepare(self) -> None:
        """Forgets earlier runs and their cancels. A caller of :meth:`cancel` calls this before each run."""
        self.about = ""
        self.given_up = self._cancelled = False

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
                reason = getattr(state, "reason", "") or "no reason is known"
                rospy.loginfo(f"{label_text(label)} was aborted: {reason}")
        self._at = list(active_states)


def gives_up_with(container: Any, last: Iterable[Any]) -> None:
    """A container gives up when one of the states that decided its outcome did."""
    gave_up = [state for state in last if getattr(state, "given_up", False)]
    container.given_up = bool(gave_up)
    container.about = getattr(gave_up[0], "about", "") if gave_up else ""


def only_cancelled(reason: str) -> bool:
    """Whether a reason says only that a state was preempted, for which another state may be the cause."""
    return reason.split(": ")[0] == "cancelled"


def _follow_reasons(machine: Any) -> None:
    """Makes containers of SMACH itself take the reason of their last states, and begin each run clean."""
    for child in machine.get_children().values():
        if not isinstance(child, Container):
            continue
        _follow_reasons(child)
        if not hasattr(child, "reason"):
            child.keeps_userdata = False
            setattr(child, "reason", "")  # noqa: B010 - SMACH's class does not declare it
            child.register_termination_cb(_take_reason, [child])


def _take_reason(userdata: Any, terminal_states: List[str], outcome: str, machine: Any) -> None:
    children = machine.get_children()
    last = [children[label] for label in terminal_states if label in children]
    gives_up_with(machine, last)
    reasons = [getattr(state, "reason", "") for state in last]
    said = list(filter(None, reasons))
    # Of states that ran at once, the one that failed counts, not those that were preempted for it.
    machine.reason = "; ".join([reason for reason in said if not only_cancelled(reason)] or said[:1])
    if outcome == "aborted" and not machine.reason and terminal_states:
        names = " and ".join(map(label_text, terminal_states))
        ended = children.get(terminal_states[-1])
        how = getattr(ended, "outcome", "") or getattr(ended, "ended_with", "")
        one = len(terminal_states) == 1  # those of a Concurrence ended together
        machine.reason = (
            f"state {names} ended with {how or 'an outcome'}, with which its machine is aborted"
            if one
            else f"states {names} ended with outcomes with which their machine is aborted"
        )
    machine.ended_with = outcome


def _note(
    state: Any,
    args: Sequence[Any],
    options: Mapping[str, Any],
    label: str,
    autonomy: Optional[Mapping[str, str]],
) -> None:
    """Leaves with a state what SMACH does not give back: for the check of the userdata, and for operators."""
    if not issubclass(type(state), State):
        return  # SMACH says so
    given = dict(zip(("remapping", "constants"), args), **options)
    state.remapping = dict(given.get("remapping") or {})
    state.constants = list(given.get("constants") or {})
    if autonomy:
        state.autonomy_levels = read_levels(label, state.get_registered_outcomes(), autonomy)

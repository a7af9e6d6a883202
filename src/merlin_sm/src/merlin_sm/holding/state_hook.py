# SPDX-License-Identifier: Apache-2.0
"""Puts the operators of a process before and behind the states of a machine."""

from typing import Any, List, Sequence

import smach
from merlin_sm.autonomy import label_text
from merlin_sm.holding.outcomes import Outcomes
from merlin_sm.holding.state_control import OUT, RUNS, Machine, StateControl

#: What has states that SMACH enters one by one or at once. A behaviour tree is entered as a whole.
CONTAINERS = (smach.StateMachine, smach.Concurrence, smach.Iterator)


def hook_states(machine: smach.Container, name: str, outcomes: Outcomes) -> None:
    """Makes a machine ask before it enters a state and when it leaves one, nested machines included.

    Once for each machine.

    :param machine: with all its states, not running.
    :param name: in the breakpoints.
    :param outcomes: of the process.
    """
    one, holds = Machine(), outcomes.holds
    controls = _controls(machine, name, one, [machine])
    for control in controls:
        outcomes.add(control)
        _hook_state(control, outcomes)
    holds.declare(name, [control.path for control in controls])
    for register in (machine.register_start_cb, machine.register_termination_cb):
        register(lambda *_: holds.end_step(one))


def _controls(container: Any, path: str, one: Machine, within: Sequence[Any]) -> List[StateControl]:
    controls: List[StateControl] = []
    for label, state in container.get_children().items():
        here = f"{path}/{label_text(label)}"
        controls.append(StateControl(one, here, state, within))
        if isinstance(state, CONTAINERS):
            controls += _controls(state, here, one, [*within, state])
    return controls


def _hook_state(control: StateControl, outcomes: Outcomes) -> None:
    """SMACH calls `execute` when it enters the state, and `request_preempt` also while that waits."""
    state, holds = control.state, outcomes.holds
    execute, request_preempt = state.execute, state.request_preempt

    def enter(*args: Any, **named: Any) -> Any:
        if holds.armed:
            unentered = outcomes.before(control)
            if unentered is not None:
                return unentered
        control.stage = RUNS
        try:
            outcome = execute(*args, **named)
        except BaseException:
            outcomes.crashed(control)
            raise
        control.stage = OUT
        # A wish that comes now finds it left, and one that came before has left its mark.
        if control.marked or holds.limited:
            return outcomes.after(control, outcome)
        return outcome

    def preempt() -> None:
        outcomes.cancel(control)
        try:
            request_preempt()
        finally:
            if holds.armed:
                holds.release(state)

    state.execute, state.request_preempt = enter, preempt

"""Puts the operators of a process before and behind the states of a machine."""

from typing import Any, List, Sequence

import smach
from merlin_sm.autonomy import label_text
from merlin_sm.holding.outcomes import Outcomes
from merlin_sm.holding.seat import OUT, RUNS, Machine, Seat

#: What has states that SMACH enters one by one or at once. A behaviour tree is entered as a whole.
CONTAINERS = (smach.StateMachine, smach.Concurrence, smach.Iterator)


def gate(machine: smach.Container, name: str, outcomes: Outcomes) -> None:
    """Makes a machine ask before it enters a state and when it leaves one, nested machines included.

    Once for each machine.

    :param machine: with all its states, not running.
    :param name: in the breakpoints.
    :param outcomes: of the process.
    """
    one, holds = Machine(), outcomes.holds
    seats = _seats(machine, name, one, [machine])
    for seat in seats:
        outcomes.add(seat)
        _gate_state(seat, outcomes)
    holds.declare(name, [seat.path for seat in seats])

    def begin(*_: Any) -> None:
        outcomes.begin(seats)
        holds.end_step(one)

    machine.register_start_cb(begin)
    machine.register_termination_cb(lambda *_: holds.end_step(one))


def _seats(container: Any, path: str, one: Machine, within: Sequence[Any]) -> List[Seat]:
    seats: List[Seat] = []
    for label, state in container.get_children().items():
        here = f"{path}/{label_text(label)}"
        seats.append(Seat(one, here, state, within))
        if isinstance(state, CONTAINERS):
            seats += _seats(state, here, one, [*within, state])
    return seats


def _gate_state(seat: Seat, outcomes: Outcomes) -> None:
    """SMACH calls `execute` when it enters the state, and `request_preempt` also while that waits."""
    state, holds = seat.state, outcomes.holds
    execute, request_preempt = state.execute, state.request_preempt

    def enter(*args: Any, **named: Any) -> Any:
        if holds.armed:
            unentered = outcomes.before(seat)
            if unentered is not None:
                return unentered
        seat.stage = RUNS
        try:
            outcome = execute(*args, **named)
        except BaseException:
            outcomes.crashed(seat)
            raise
        seat.stage = OUT
        # A wish that comes now finds it left, and one that came before has left its mark.
        if seat.marked or holds.limited:
            return outcomes.after(seat, outcome)
        return outcome

    def preempt() -> None:
        outcomes.cancel(seat)
        try:
            request_preempt()
        finally:
            if holds.armed:
                holds.release(state)

    state.execute, state.request_preempt = enter, preempt

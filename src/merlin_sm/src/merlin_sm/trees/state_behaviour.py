# SPDX-License-Identifier: Apache-2.0
"""A state as a behaviour of a tree."""

from typing import Callable, List, Mapping, Optional, Sequence

import py_trees
from py_trees.common import Status

import smach
from merlin_sm.autonomy import label_text
from merlin_sm.merlin_sm import MerlinSM
from merlin_sm.states.function_state import FunctionState
from merlin_sm.states.merlin_state import SUCCEEDED
from merlin_sm.trees.state_run import StateRun


class StateBehaviour(py_trees.behaviour.Behaviour):
    """Runs a state: RUNNING until it has ended, then SUCCESS or FAILURE by its outcome.

    A function runs within the tick, so it may be a condition. Every other state begins after the tick, in a
    thread of its own, and the tree is ticked when it has ended. A behaviour that is interrupted preempts its
    state at once.

    :param name: of the behaviour.
    :param state: any state or machine.
    :param success: its outcomes that are SUCCESS; all others are FAILURE.
    :param remapping: userdata key of the state → userdata key of the tree.
    :raises ValueError: when the state does not have one of the outcomes.
    """

    def __init__(
        self,
        name: str,
        state: smach.State,
        success: Sequence[str] = (SUCCEEDED,),
        remapping: Optional[Mapping[str, str]] = None,
    ) -> None:
        super().__init__(name)
        outcomes = list(state.get_registered_outcomes())
        unknown = [outcome for outcome in success if outcome not in outcomes]
        if unknown:
            known = ", ".join(map(label_text, outcomes))
            raise ValueError(f"behaviour {name!r}: its state has no outcome {unknown[0]!r}, only {known}")
        self.state = state
        # In a machine: SMACH clears a preempt that comes before a nested machine runs, MerlinSM keeps it.
        self.machine = MerlinSM(outcomes)
        self.machine.keeps_userdata = True  # it is the tree's
        with self.machine:
            self.machine.add(name, state, remapping=dict(remapping or {}))
        self.success = tuple(success)
        self._names = dict(remapping or {})
        self._run: Optional[StateRun] = None

    @property
    def acts(self) -> bool:
        """Whether the state runs; also one that was interrupted and has not stopped yet."""
        return self._run is not None and not self._run.ended.is_set()

    @property
    def due(self) -> bool:
        """Whether the tree has to start the state."""
        return self.status == Status.RUNNING and self._run is None

    @property
    def sets(self) -> List[str]:
        """Keys of the tree's userdata that the state sets."""
        return [self._names.get(key, key) for key in self.state.get_registered_output_keys()]

    def initialise(self) -> None:
        """A new run begins."""
        self._run = None
        self.feedback_message = ""

    def update(self) -> Status:
        """Returns whether the state runs, or how it ended.

        :raises BaseException: what the state has raised.
        """
        if self._run is None and isinstance(self.state, FunctionState):
            self._run = StateRun(self.machine)
            self._run.run()
        if self._run is None or self.acts:
            return Status.RUNNING
        if self._run.error is not None:
            raise self._run.error
        outcome = self._run.outcome
        if outcome in self.success:
            return Status.SUCCESS
        self.feedback_message = self.machine.reason or f"{self.name} ended with {outcome}"
        return Status.FAILURE

    def start(self, on_end: Callable[[StateRun], None]) -> StateRun:
        """Prepares the run that is due.

        :param on_end: as that of the run.
        """
        self._run = StateRun(self.machine, on_end)
        return self._run

    def terminate(self, new_status: Status) -> None:
        """Interrupts the state when it runs."""
        if self._run is not None and self.acts:
            self._run.interrupt()

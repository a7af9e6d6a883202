# SPDX-License-Identifier: Apache-2.0
"""A state machine whose states follow one another in the order they were added."""

from typing import Any, Iterable, Mapping, Optional

from smach.exceptions import InvalidStateError
from smach.execution import construction
from smach.labels import is_name, mapping_of
from smach.state import State
from smach.state_machine import StateMachine


class Sequence(StateMachine):
    """A state machine in which one outcome of each state leads to the state added next.

    :param outcomes: that executing it may end with.
    :param connector_outcome: the outcome that leads on, unless a state binds it itself.
    :param input_keys: userdata keys copied from the parent when it starts.
    :param output_keys: userdata keys copied to the parent when it ends.
    """

    def __init__(
        self,
        outcomes: Iterable[str],
        connector_outcome: str,
        input_keys: Optional[Iterable[str]] = None,
        output_keys: Optional[Iterable[str]] = None,
    ) -> None:
        super().__init__(outcomes, input_keys, output_keys)
        if not is_name(connector_outcome):
            raise InvalidStateError(
                f"Sequence: connector_outcome must be an outcome, not {connector_outcome!r}"
            )
        self._connector_outcome = connector_outcome

    @staticmethod
    def add(
        label: str,
        state: State,
        transitions: Optional[Mapping[str, Optional[str]]] = None,
        remapping: Optional[Mapping[str, str]] = None,
        constants: Optional[Mapping[str, Any]] = None,
    ) -> State:
        """Adds a state to the innermost open sequence.

        :param transitions: as for a state machine; the connector outcome may be bound here.
        :param remapping: userdata key of the state -> userdata key of the sequence.
        :param constants: userdata key of the sequence -> value the state reads there.
        :return: the state.
        """
        sequence = construction.innermost(Sequence, "Sequence.add")
        connector = sequence._connector_outcome
        bound = mapping_of(transitions, sequence._path(label), "transitions", "outcome -> label")
        connects = (
            hasattr(state, "_outcomes")  # _add says why it has none
            and connector in state.get_registered_outcomes()
            and connector not in bound
        )
        return sequence._add(label, state, transitions, remapping, constants, [connector] if connects else [])

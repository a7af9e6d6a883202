# SPDX-License-Identifier: Apache-2.0
"""The container that executes one child after the other."""

from typing import Any, Dict, Iterable, List, Mapping, Optional, Sequence

import smach
from smach.container import Container, Edge
from smach.exceptions import InvalidStateError, InvalidTransitionError
from smach.execution import construction
from smach.labels import is_name, mapping_of, text_of
from smach.state import State
from smach.user_data import UserData


class StateMachine(Container):
    """Executes one child at a time; the outcome of each decides what comes next.

    :param outcomes: that executing it may end with.
    :param input_keys: userdata keys copied from the parent when it starts.
    :param output_keys: userdata keys copied to the parent when it ends.
    """

    def __init__(
        self,
        outcomes: Iterable[str],
        input_keys: Optional[Iterable[str]] = None,
        output_keys: Optional[Iterable[str]] = None,
    ) -> None:
        super().__init__(outcomes, input_keys, output_keys)
        self._states: Dict[str, State] = {}
        self._transitions: Dict[str, Dict[str, Optional[str]]] = {}
        self._remappings: Dict[str, Dict[str, str]] = {}
        self._constants: Dict[str, Dict[str, Any]] = {}
        self._pending_connectors: List[tuple[str, str]] = []  # (label, outcome) that lead to the next state
        self._initial_state_label: Optional[str] = None
        self._current_label: Optional[str] = None
        self._current_state: Optional[State] = None
        self._preempted_label: Optional[str] = None
        self._preempted_state: Optional[State] = None

    # --- construction --------------------------------------------------------------------------------------

    @staticmethod
    def add(
        label: str,
        state: State,
        transitions: Optional[Mapping[str, Optional[str]]] = None,
        remapping: Optional[Mapping[str, str]] = None,
        constants: Optional[Mapping[str, Any]] = None,
    ) -> State:
        """Adds a state to the innermost open state machine; the first one is the initial state.

        :param transitions: outcome -> label of the next state, or outcome of the machine; what is not listed
            (or None) ends the machine with the outcome of the same name.
        :param remapping: userdata key of the state -> userdata key of the machine.
        :param constants: userdata key of the machine -> value that this state reads there.
        :return: the state.
        :raises SmachError: with the path of the container and the label.
        """
        machine = construction.innermost(StateMachine, "StateMachine.add")
        return machine._add(label, state, transitions, remapping, constants, [])

    @staticmethod
    def add_auto(
        label: str,
        state: State,
        connector_outcomes: Iterable[str],
        transitions: Optional[Mapping[str, Optional[str]]] = None,
        remapping: Optional[Mapping[str, str]] = None,
        constants: Optional[Mapping[str, Any]] = None,
    ) -> State:
        """Adds a state as :meth:`add` does.

        :param connector_outcomes: outcomes that lead to the state that is added next.
        """
        machine = construction.innermost(StateMachine, "StateMachine.add_auto")
        return machine._add(label, state, transitions, remapping, constants, list(connector_outcomes))

    def _add(
        self,
        label: str,
        state: State,
        transitions: Optional[Mapping[str, Optional[str]]],
        remapping: Optional[Mapping[str, str]],
        constants: Optional[Mapping[str, Any]],
        connectors: List[str],
    ) -> State:
        self._adopt(label, state)
        where = self._path(label)
        outcomes = state.get_registered_outcomes()
        defaults = dict(construction.defaults())
        bindings = {
            key: to for key, to in (defaults.pop("transitions", None) or {}).items() if key in outcomes
        }
        bindings.update(mapping_of(transitions, where, "transitions", "outcome -> label"))
        remapping = mapping_of(remapping, where, "remapping", "state key -> container key")
        remapping = {**(defaults.pop("remapping", None) or {}), **remapping}
        constants = mapping_of(constants, where, "constants", "container key -> value")
        constants = {**(defaults.pop("constants", None) or {}), **constants}
        connectors = connectors or [
            key for key in defaults.pop("connector_outcomes", ()) or () if key in outcomes
        ]
        if defaults:
            raise InvalidStateError(f"'{where}': opened() was given unknown arguments: {sorted(defaults)}")
        for outcome in [*bindings, *connectors]:
            if outcome not in outcomes:
                raise InvalidTransitionError(
                    f"'{where}': there is a transition for outcome '{outcome}', which the state has not "
                    f"registered; its outcomes: {list(outcomes)}"
                )
        # An empty target means the container outcome of the same name; 0 and False are labels.
        targets = {to: None if bindings.get(to) == "" else bindings.get(to) for to in outcomes}
        self.check_state_spec(label, state, targets)
        for previous, outcome in self._pending_connectors:
            self._transitions[previous][outcome] = label
        self._pending_connectors = [(label, outcome) for outcome in connectors]
        self._states[label] = state
        self._transitions[label] = targets
        self._remappings[label] = remapping
        self._constants[label] = constants
        if self._initial_state_label is None:
            self._initial_state_label = label
        return state

    def check_state_spec(
        self, label: str, state: State, transitions: Optional[Mapping[str, Optional[str]]]
    ) -> None:
        """Checks the transitions of a state.

        :raises InvalidTransitionError: when a target cannot be a label, or the state lacks an outcome.
        """
        for outcome, target in (transitions or {}).items():
            if outcome not in state.get_registered_outcomes():
                raise InvalidTransitionError(
                    f"'{self._path(label)}': there is a transition for the unregistered outcome '{outcome}'"
                )
            if target is not None and not is_name(target):
                raise InvalidTransitionError(
                    f"'{self._path(label)}': outcome '{outcome}' leads to {target!r}, which is not a label"
                )

    def check_consistency(self) -> None:
        """Checks that there is an initial state and that every transition leads somewhere.

        :raises InvalidStateError: there is no (known) initial state.
        :raises InvalidTransitionError: transitions that lead nowhere; all of them are named.
        """
        if self._initial_state_label is None:
            raise InvalidStateError(f"State machine '{self._path()}' has no initial state: it has no states")
        if self._initial_state_label not in self._states:
            raise InvalidStateError(
                f"State machine '{self._path()}': the initial state "
                f"'{self._initial_state_label}' is not one of its states {list(self._states)}"
            )
        errors = []
        for label, transitions in self._transitions.items():
            for outcome, target in transitions.items():
                if target is None and outcome not in self._outcomes:
                    errors.append(
                        f"outcome '{outcome}' of state '{self._path(label)}' has no transition, "
                        "and the machine has no outcome of that name"
                    )
                elif target is not None and target not in self._states and target not in self._outcomes:
                    errors.append(
                        f"outcome '{outcome}' of state '{self._path(label)}' leads to '{target}', which is "
                        "neither a state nor an outcome of the machine"
                    )
        if errors:
            raise InvalidTransitionError(
                f"State machine '{self._path()}' is inconsistent: {'; '.join(errors)}. "
                f"States: {list(self._states)}, outcomes: {list(self._outcomes)}"
            )

    # --- introspection -------------------------------------------------------------------------------------

    def get_children(self) -> Dict[str, State]:
        """The children by label."""
        return self._states

    def get_initial_states(self) -> List[str]:
        """The label of the initial state, in a list."""
        return ["None" if self._initial_state_label is None else self._initial_state_label]

    def set_initial_state(self, initial_states: Sequence[str], userdata: Optional[UserData] = None) -> None:
        """Chooses the first of the labels as the initial state of coming runs and adds to the userdata."""
        initial_states = [initial_states] if isinstance(initial_states, str) else list(initial_states)
        if len(initial_states) > 1:
            smach.logwarn(
                f"State machine '{self._path()}' has one initial state; taking the first of {initial_states}"
            )
        if initial_states:
            self._initial_state_label = initial_states[0]
        if userdata is not None:
            self.userdata.update(userdata)

    def get_active_states(self) -> List[str]:
        """The label of the state being executed, in a list; ``["None"]`` between runs."""
        label = self._current_label
        return ["None" if label is None else label]

    def get_idle_states(self) -> List[str]:
        """What :meth:`get_active_states` returns between runs."""
        return ["None"]

    def get_internal_edges(self) -> List[Edge]:
        """Transitions as (outcome, from label, to label); None: to the machine's outcome of that name."""
        return [
            (outcome, label, target)
            for label, transitions in self._transitions.items()
            for outcome, target in transitions.items()
        ]

    # --- running -------------------------------------------------------------------------------------------

    def _smach_run(self) -> Optional[str]:
        try:
            self._set_current(self._initial_state_label)
            smach.logdebug(f"State machine starting in initial state '{text_of(self._initial_state_label)}'")
            self.call_start_cbs()
            outcome = None
            while outcome is None and not smach.is_shutdown():
                outcome = self._step()
            if outcome is not None:
                self.call_termination_cbs(self.get_active_states(), outcome)
            return outcome
        finally:
            self._set_current(None)

    def _set_current(self, label: Optional[str]) -> None:
        with self._smach_lock:
            self._current_label = label
            self._current_state = self._states[label] if label is not None else None

    def _step(self) -> Optional[str]:
        """Executes the current state and makes the transition.

        :return: the machine's outcome if the transition leaves it.
        """
        label, state = self._current_label, self._current_state
        assert label is not None and state is not None  # set by _set_current
        ud = self._view(state, self._remappings.get(label, {}), self._constants.get(label))
        outcome, _ = self._execute_child(label, state, ud)
        if outcome is None:
            return None
        target = self._transitions[label].get(outcome)
        if target in self._states:
            at, to = f"'{text_of(label)}':'{text_of(outcome)}'", text_of(target)
            smach.logdebug(f"State machine transitioning {at}-->'{to}'")
            self._set_current(target)
            self.call_transition_cbs()
            return None
        container_outcome = outcome if target is None else target
        if container_outcome not in self._outcomes:
            raise InvalidTransitionError(
                f"Outcome '{outcome}' of state '{self._path(label)}' leads to "
                f"'{container_outcome}', which is neither a state nor an outcome of the machine"
            )
        end = "':'".join(map(text_of, (label, outcome, container_outcome)))
        smach.logdebug(f"State machine terminating '{end}'")
        return container_outcome

    def request_preempt(self) -> None:
        """Asks the current state to end; if it does not act on it, those that follow."""
        self._preempted_label, self._preempted_state = self._current_label, self._current_state
        super().request_preempt()

# SPDX-License-Identifier: Apache-2.0
"""The container that executes all its children at the same time."""

from typing import Any, Callable, Dict, Iterable, List, Mapping, Optional, Sequence

import smach
from smach.container import Container, Edge
from smach.exceptions import InvalidStateError, InvalidTransitionError, InvalidUserCodeError
from smach.execution import construction
from smach.execution.concurrent_run import ConcurrentRun
from smach.labels import is_name, mapping_of, text_of
from smach.state import State
from smach.user_data import UserData

PREEMPTED = "preempted"  # the outcome of a Concurrence whose children have all acted on a preempt request


class Concurrence(Container):
    """Executes each child in a thread of its own and ends when all have ended.

    :param outcomes: that executing it may end with.
    :param default_outcome: where neither the callback nor the map says otherwise.
    :param input_keys: userdata keys copied from the parent when it starts.
    :param output_keys: userdata keys copied to the parent when it ends.
    :param outcome_map: outcome -> {child label: child outcome}; of the entries that hold, the one with most
        criteria decides, of equal ones the first.
    :param outcome_cb: called with {child label: child outcome}; returns the outcome, or None to leave it to
        the map and the default.
    :param child_termination_cb: called with {child label: child outcome or None} whenever a child ends; a
        list of labels preempts these, anything else that is true preempts all that still run.
    :raises InvalidStateError: the policies contradict the outcomes.
    """

    def __init__(
        self,
        outcomes: Iterable[str],
        default_outcome: str,
        input_keys: Optional[Iterable[str]] = None,
        output_keys: Optional[Iterable[str]] = None,
        outcome_map: Optional[Mapping[str, Mapping[str, str]]] = None,
        outcome_cb: Optional[Callable[[Dict[str, str]], Optional[str]]] = None,
        child_termination_cb: Optional[Callable[[Dict[str, Optional[str]]], Any]] = None,
    ) -> None:
        super().__init__(outcomes, input_keys, output_keys)
        self._states: Dict[str, State] = {}
        self._remappings: Dict[str, Dict[str, str]] = {}
        self._default_outcome = default_outcome
        shape = "child label -> child outcome"
        self._outcome_map = {
            outcome: mapping_of(criteria, "Concurrence", f"outcome_map[{outcome!r}]", shape)
            for outcome, criteria in mapping_of(
                outcome_map, "Concurrence", "outcome_map", f"outcome -> {{{shape}}}"
            ).items()
        }
        self._outcome_cb = outcome_cb
        self._child_termination_cb = child_termination_cb
        self._concurrent_run: Optional[ConcurrentRun] = None
        self._child_outcomes: Dict[str, Optional[str]] = {}  # of the present or the last run
        for outcome in [default_outcome, *self._outcome_map]:
            if outcome not in self._outcomes:
                raise InvalidStateError(
                    f"Concurrence: outcome '{outcome}' of its policies is not one of its outcomes "
                    f"{list(self._outcomes)}"
                )
        for outcome, criteria in self._outcome_map.items():
            for label, child_outcome in criteria.items():
                if not is_name(child_outcome):  # forks of SMACH take lists
                    raise InvalidStateError(
                        f"Concurrence: outcome_map[{outcome!r}] must name one outcome of '{text_of(label)}', "
                        f"not {child_outcome!r}"
                    )
        for name, cb in (("outcome_cb", outcome_cb), ("child_termination_cb", child_termination_cb)):
            if cb is not None and not callable(cb):
                raise InvalidStateError(f"Concurrence: {name} must be callable, not {cb!r}")

    @staticmethod
    def add(label: str, state: State, remapping: Optional[Mapping[str, str]] = None) -> State:
        """Adds a state to the innermost open Concurrence.

        :param remapping: userdata key of the state -> userdata key of the Concurrence.
        :return: the state.
        :raises InvalidStateError: with the path of the container and the label.
        """
        container = construction.innermost(Concurrence, "Concurrence.add")
        container._adopt(label, state)
        defaults = dict(construction.defaults())
        given = defaults.pop("remapping", None) or {}
        if defaults:
            raise InvalidStateError(
                f"'{container._path(label)}': opened() was given unknown arguments: {sorted(defaults)}"
            )
        remapping = mapping_of(remapping, container._path(label), "remapping", "state key -> container key")
        container._remappings[label] = {**given, **remapping}
        container._states[label] = state
        return state

    def check_consistency(self) -> None:
        """Checks that there are children and that the outcome map speaks of them.

        :raises InvalidStateError: when it has no children, or the map names a child that does not exist.
        :raises InvalidTransitionError: the map names an outcome that its child does not have.
        """
        if not self._states:
            raise InvalidStateError(f"Concurrence '{self._path()}' has no children")
        for outcome, criteria in self._outcome_map.items():
            for label, child_outcome in criteria.items():
                if label not in self._states:
                    raise InvalidStateError(
                        f"Concurrence '{self._path()}': the outcome map's '{outcome}' names "
                        f"the child '{label}', which does not exist; children: {list(self._states)}"
                    )
                registered = self._states[label].get_registered_outcomes()
                if child_outcome not in registered:
                    raise InvalidTransitionError(
                        f"Concurrence '{self._path()}': the outcome map's '{outcome}' waits for outcome "
                        f"'{child_outcome}' of '{label}', which has only {list(registered)}"
                    )

    # --- introspection -------------------------------------------------------------------------------------

    def get_children(self) -> Dict[str, State]:
        """The children by label."""
        return self._states

    def get_initial_states(self) -> List[str]:
        """All labels."""
        return list(self._states)

    def set_initial_state(self, initial_states: Sequence[str], userdata: Optional[UserData] = None) -> None:
        """Adds to the userdata; the initial states are always all children.

        :raises InvalidStateError: a label that is not a child's.
        """
        super().set_initial_state(initial_states, userdata)
        if initial_states and set(initial_states) != set(self._states):
            smach.logwarn(
                f"Concurrence '{self._path()}' starts all its children {list(self._states)}, not only "
                f"{list(initial_states)}"
            )

    def get_active_states(self) -> List[str]:
        """Labels of the children that have not ended; empty between runs."""
        with self._smach_lock:
            return list(self._concurrent_run.active) if self._concurrent_run is not None else []

    def get_internal_edges(self) -> List[Edge]:
        """The outcome map as (child outcome, child label, outcome)."""
        return [
            (child_outcome, label, outcome)
            for outcome, criteria in self._outcome_map.items()
            for label, child_outcome in criteria.items()
        ]

    # --- running -------------------------------------------------------------------------------------------

    def _smach_run(self) -> Optional[str]:
        smach.logdebug(f"Concurrence starting with states {list(self._states)}")
        run = ConcurrentRun(self, self._states)
        try:
            with self._smach_lock:
                self._concurrent_run, self._child_outcomes = run, run.outcomes
            self.call_start_cbs()
            if not run.execute():
                return None
            outcome = self._outcome(run)
            smach.logdebug(f"Concurrence terminating with outcome '{text_of(outcome)}'")
            self.call_termination_cbs(list(self._states), outcome)
            return outcome
        finally:
            with self._smach_lock:
                self._concurrent_run = None

    def _outcome(self, run: ConcurrentRun) -> str:
        outcomes: Dict[str, Any] = dict(run.outcomes)
        with self._smach_lock:
            # A request that came when no child ran any more, or that one ignored, is left to the parent.
            if self._preempt_requested and run.unserved and not any(run.unserved.values()):
                self._preempt_requested = False
                if PREEMPTED in self._outcomes:
                    return PREEMPTED
        for choose in (self._outcome_by_callback, self._outcome_by_map):
            outcome = choose(outcomes)
            if outcome is not None:  # 0 and False may be outcomes
                return outcome
        return self._default_outcome

    def _outcome_by_callback(self, outcomes: Dict[str, str]) -> Optional[str]:
        if self._outcome_cb is None:
            return None
        try:
            outcome = self._outcome_cb(dict(outcomes))
        except Exception as error:
            raise InvalidUserCodeError(
                f"Concurrence '{self._path()}': outcome_cb raised {type(error).__name__}: {error}"
            ) from error
        if not outcome and outcome not in self._outcomes:
            smach.logwarn(
                f"Concurrence '{self._path()}': outcome_cb returned {outcome!r}; using the outcome map"
            )
            return None
        if outcome not in self._outcomes:
            raise InvalidTransitionError(
                f"Concurrence '{self._path()}': outcome_cb returned '{outcome}', which is not one "
                f"of its outcomes {list(self._outcomes)}"
            )
        return outcome

    def _outcome_by_map(self, outcomes: Dict[str, str]) -> Optional[str]:
        holding = [
            (len(criteria), outcome)
            for outcome, criteria in self._outcome_map.items()
            if all(outcomes[label] == child_outcome for label, child_outcome in criteria.items())
        ]
        return max(holding, key=lambda entry: entry[0])[1] if holding else None

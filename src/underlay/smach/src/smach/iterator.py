# SPDX-License-Identifier: Apache-2.0
"""The container that executes its child once per item of a list."""

from typing import Any, Callable, Dict, Iterable, List, Mapping, Optional, Union
from typing import Iterator as Items

import smach
from smach.container import Container, Edge, names
from smach.exceptions import InvalidStateError, InvalidTransitionError, InvalidUserCodeError
from smach.execution import construction
from smach.labels import mapping_of, text_of
from smach.state import State

PREEMPTED = "preempted"


class Iterator(Container):
    """Executes its child for one item after the other, until they are exhausted or an outcome ends the loop.

    :param outcomes: that executing it may end with; the exhausted outcome is added.
    :param input_keys: userdata keys copied from the parent when it starts.
    :param output_keys: userdata keys copied to the parent when it ends.
    :param it: the items, or a callable that returns them for each run.
    :param it_label: userdata key that holds the current item.
    :param exhausted_outcome: outcome after the last item.
    """

    def __init__(
        self,
        outcomes: Iterable[str],
        input_keys: Iterable[str],
        output_keys: Iterable[str],
        it: Union[Iterable[Any], Callable[[], Iterable[Any]]] = (),
        it_label: str = "it_data",
        exhausted_outcome: str = "exhausted",
    ) -> None:
        super().__init__([*names(outcomes, "outcomes"), exhausted_outcome], input_keys, output_keys)
        self._exhausted_outcome = exhausted_outcome
        self._state_label: str = ""
        self._state: Optional[State] = None
        self._loop_outcomes: List[str] = []
        self._break_outcomes: List[str] = []
        self._final_outcome_map: Dict[str, str] = {}
        self._set_items(it, it_label)

    @staticmethod
    def set_iteritems(
        it: Union[Iterable[Any], Callable[[], Iterable[Any]]], it_label: str = "it_data"
    ) -> None:
        """Sets the items of the innermost open Iterator.

        :param it: the items, or a callable that returns them for each run.
        :param it_label: userdata key that holds the current item.
        """
        construction.innermost(Iterator, "Iterator.set_iteritems")._set_items(it, it_label)

    @staticmethod
    def set_contained_state(
        label: str,
        state: State,
        loop_outcomes: Optional[Iterable[str]] = None,
        break_outcomes: Optional[Iterable[str]] = None,
        final_outcome_map: Optional[Mapping[str, str]] = None,
    ) -> State:
        """Sets the child of the innermost open Iterator.

        :param loop_outcomes: if given, every other outcome ends the loop.
        :param break_outcomes: outcomes that end the loop. With neither list, only the last item or a preempt
            request does.
        :param final_outcome_map: outcome of the child -> outcome of the Iterator.
        :return: the state.
        """
        container = construction.innermost(Iterator, "Iterator.set_contained_state")
        if container._state is not None:
            raise InvalidStateError(
                f"'{container._path(label)}': an Iterator has one state; it has '{container._state_label}'"
            )
        container._adopt(label, state)
        finals = mapping_of(
            final_outcome_map, container._path(label), "final_outcome_map", "outcome -> final outcome"
        )
        container._state_label, container._state = label, state
        container._loop_outcomes = names(loop_outcomes, "loop_outcomes")
        container._break_outcomes = names(break_outcomes, "break_outcomes")
        container._final_outcome_map = finals
        return state

    def _set_items(self, it: Any, it_label: str) -> None:
        if not callable(it):
            try:
                # An iterator can be read only once: remember its items for the runs that follow.
                it = _Remembered(it) if iter(it) is it else it
            except TypeError:
                raise InvalidStateError(
                    f"Iterator '{self._path()}': items must be iterable or return something "
                    f"iterable, not {it!r}"
                ) from None
        self._items, self._items_label = it, it_label

    def check_consistency(self) -> None:
        """Checks that there is a state and that all its ways out are outcomes of the Iterator.

        :raises InvalidStateError: there is no state.
        :raises InvalidTransitionError: an outcome that the state or the Iterator does not have.
        """
        if self._state is None:
            raise InvalidStateError(f"Iterator '{self._path()}' has no contained state")
        registered = self._state.get_registered_outcomes()
        for outcome in [*self._loop_outcomes, *self._break_outcomes, *self._final_outcome_map]:
            if outcome not in registered and outcome != self._exhausted_outcome:
                raise InvalidTransitionError(
                    f"Iterator '{self._path()}' speaks of outcome '{outcome}', which its state "
                    f"'{self._state_label}' does not have: {list(registered)}"
                )
        for outcome in registered:
            final = self._final_outcome_map.get(outcome, outcome)
            if self._breaks(outcome) and final not in self._outcomes:
                raise InvalidTransitionError(
                    f"Iterator '{self._path()}': outcome '{outcome}' of '{self._state_label}' ends it with "
                    f"'{final}', which is not one of its outcomes {list(self._outcomes)}"
                )

    def _breaks(self, outcome: str) -> bool:
        return outcome in self._break_outcomes or bool(
            self._loop_outcomes and outcome not in self._loop_outcomes
        )

    # --- introspection -------------------------------------------------------------------------------------

    def get_children(self) -> Dict[str, State]:
        """The child by its label."""
        return {self._state_label: self._state} if self._state is not None else {}

    def get_initial_states(self) -> List[str]:
        """The child's label, in a list."""
        return list(self.get_children())

    def get_active_states(self) -> List[str]:
        """The child's label while the Iterator runs, in a list."""
        return self.get_initial_states() if self._is_running else []

    def get_internal_edges(self) -> List[Edge]:
        """Loops as (outcome, label, label), ways out as (outcome, label, outcome of the Iterator)."""
        edges: List[Edge] = []
        for outcome in self._state.get_registered_outcomes() if self._state is not None else ():
            final = self._final_outcome_map.get(outcome, outcome)
            edges.append((outcome, self._state_label, final if self._breaks(outcome) else self._state_label))
        if self._state is not None:
            edges.append((self._exhausted_outcome, self._state_label, self._final_exhausted()))
        return edges

    # --- running -------------------------------------------------------------------------------------------

    def _smach_run(self) -> Optional[str]:
        smach.logdebug(f"Iterator starting with state '{text_of(self._state_label)}'")
        self.call_start_cbs()
        outcome = self._loop()
        if outcome is not None:
            smach.logdebug(f"Iterator terminating with outcome '{text_of(outcome)}'")
            self.call_termination_cbs([self._state_label], outcome)
        return outcome

    def _loop(self) -> Optional[str]:
        state = self._state
        assert state is not None  # check_consistency
        first = True
        for item in self._each():
            if smach.is_shutdown():
                return None
            self.userdata[self._items_label] = item
            if not first:
                self.call_transition_cbs()
            first = False
            # As in SMACH the child gets the userdata itself, not a view limited to its keys.
            outcome, preempted = self._execute_child(self._state_label, state, self.userdata)
            if outcome is None:
                return None
            if preempted or self._breaks(outcome):
                return self._final(outcome, preempted)
        return self._final_exhausted()

    def _each(self) -> Items[Any]:
        try:
            yield from self._items() if callable(self._items) else self._items
        except Exception as error:
            raise InvalidUserCodeError(
                f"Iterator '{self._path()}': its items raised {type(error).__name__}: {error}"
            ) from error

    def _final(self, outcome: str, preempted: bool) -> str:
        final = self._final_outcome_map.get(outcome, outcome)
        if final in self._outcomes:
            return final
        if preempted and PREEMPTED in self._outcomes:
            return PREEMPTED
        raise InvalidTransitionError(
            f"Iterator '{self._path()}' was preempted and its state ended with '{outcome}', but "
            f"neither '{final}' nor '{PREEMPTED}' is one of its outcomes {list(self._outcomes)}"
        )

    def _final_exhausted(self) -> str:
        final = self._final_outcome_map.get(self._exhausted_outcome, self._exhausted_outcome)
        return final if final in self._outcomes else self._exhausted_outcome


class _Remembered:
    """Items of an iterator, which remembers them: it can be gone through again and again."""

    def __init__(self, source: Items[Any]) -> None:
        self._source = source
        self._seen: List[Any] = []

    def __iter__(self) -> Items[Any]:
        i = 0
        while True:
            if i == len(self._seen):
                try:
                    self._seen.append(next(self._source))
                except StopIteration:
                    return
            yield self._seen[i]
            i += 1

# SPDX-License-Identifier: Apache-2.0
"""The base of all states that consist of other states."""

import contextlib
import functools
import traceback
import weakref
from typing import Any, Callable, Dict, Iterable, Iterator, List, Mapping, Optional, Sequence, Tuple

import smach
from smach.exceptions import (
    InvalidStateError,
    InvalidTransitionError,
    InvalidUserCodeError,
    SmachError,
)
from smach.execution import construction
from smach.execution.preemption import PreemptibleContainer
from smach.labels import is_name, text_of
from smach.log import wake_at_shutdown
from smach.state import State, names
from smach.user_data import Remapper, UserData

Edge = Tuple[str, str, Optional[str]]
_Callback = Tuple[Callable[..., None], List[Any]]


class Container(PreemptibleContainer):
    """A state that executes other states, its children; abstract.

    :param outcomes: that executing it may end with.
    :param input_keys: userdata keys copied from the parent when it starts.
    :param output_keys: userdata keys copied to the parent when it ends.
    :ivar userdata: shared by its children. It survives between runs.
    :cvar keeps_userdata: set to False (on the object or a class) for runs that begin clean: what only a run
        brought about is there until the next one begins, and what is set from outside survives.
    """

    keeps_userdata: bool = True

    def __init__(
        self,
        outcomes: Optional[Iterable[str]] = None,
        input_keys: Optional[Iterable[str]] = None,
        output_keys: Optional[Iterable[str]] = None,
    ) -> None:
        super().__init__(outcomes, input_keys, output_keys)
        self.userdata = UserData()
        self._start_cbs: List[_Callback] = []
        self._transition_cbs: List[_Callback] = []
        self._termination_cbs: List[_Callback] = []
        self._smach_parent: Optional[weakref.ref[Container]] = None
        self._smach_label: Any = ""

    # --- what it consists of -------------------------------------------------------------------------------

    def get_children(self) -> Dict[str, State]:
        """The children by label."""
        raise NotImplementedError

    def __getitem__(self, key: str) -> State:
        return self.get_children()[key]

    def get_initial_states(self) -> List[str]:
        """Labels of the children that a run starts with."""
        raise NotImplementedError

    def set_initial_state(self, initial_states: Sequence[str], userdata: Optional[UserData] = None) -> None:
        """Adds to the userdata; with which children a run starts is given.

        :raises InvalidStateError: a label that is not a child's.
        """
        children = self.get_children()
        unknown = [label for label in initial_states if label not in children]
        if unknown:
            raise InvalidStateError(
                f"{type(self).__name__} '{self._path()}': initial states {unknown} are not children; "
                f"children: {list(children)}"
            )
        if userdata is not None:
            self.userdata.update(userdata)

    def get_active_states(self) -> List[str]:
        """Labels of the children being executed."""
        raise NotImplementedError

    def get_idle_states(self) -> List[str]:
        """What :meth:`get_active_states` returns between runs."""
        return []

    def get_internal_edges(self) -> List[Edge]:
        """Transitions as (outcome, from label, to label); None: to the container's outcome of that name."""
        raise NotImplementedError

    def check_consistency(self) -> None:
        """Checks the definition.

        :raises SmachError: it cannot be executed.
        """
        raise NotImplementedError

    # --- construction --------------------------------------------------------------------------------------

    def open(self) -> None:
        """Makes it the container that ``add`` of this thread adds to."""
        construction.push(self)

    def close(self) -> None:
        """Ends :meth:`open`. What is wrong with the definition, or missing, is logged as an error.

        It may be opened again and completed; :meth:`execute` raises what is still wrong.
        """
        construction.pop(self)
        with contextlib.suppress(SmachError):  # logged when it was made
            self.check_consistency()

    def is_opened(self) -> bool:
        """Whether this thread has it open."""
        return construction.is_open(self)

    def assert_opened(self, msg: str = "Not currently open.") -> None:
        """Raises InvalidStateError unless this thread has it open."""
        if not self.is_opened():
            raise InvalidStateError(f"{self._path()}: {msg}")

    @contextlib.contextmanager
    def opened(self, **kwargs: Any) -> Iterator["Container"]:
        """Opens it for a ``with`` block.

        :param kwargs: arguments (``transitions``, ``remapping``, …) for every ``add`` in the block; those
            given to an ``add`` itself come first.
        """
        construction.push(self, kwargs)
        try:
            yield self
        except BaseException:
            construction.pop(self)
            raise
        self.close()

    def __enter__(self) -> "Container":
        self.open()
        return self

    def __exit__(self, error_type: Optional[type], error: Optional[BaseException], trace: Any) -> None:
        if error is None:
            self.close()
        else:
            construction.pop(self)

    @classmethod
    def _currently_opened_container(cls) -> Any:
        """The innermost open container of this thread, for an ``add`` of a class of one's own.

        :raises InvalidStateError: none is open, or one that is not of this class.
        """
        return construction.innermost(cls, f"{cls.__name__}.add")

    def _adopt(self, label: str, state: State) -> None:
        """Checks a child that is being added, and makes it one.

        :raises InvalidStateError: when the label is taken, or the object is not a state.
        """
        where = self._path(label)
        if not is_name(label):
            raise InvalidStateError(
                f"'{where}': a label must be a text, a member of an enumeration or a number, not {label!r}"
            )
        if not isinstance(state, State):
            raise InvalidStateError(f"'{where}': {state!r} is not a smach.State")
        if not hasattr(state, "_outcomes"):
            raise InvalidStateError(
                f"'{where}': {type(state).__name__}.__init__ does not call super().__init__()"
            )
        if label in self.get_children():
            raise InvalidStateError(f"'{where}': there is a state of this label already")
        ancestor: Optional[Container] = self
        while ancestor is not None:
            if ancestor is state:
                raise InvalidStateError(f"'{where}': a container cannot contain itself")
            ancestor = ancestor._smach_parent() if ancestor._smach_parent is not None else None
        if isinstance(state, Container):
            state._smach_parent = weakref.ref(self)
            state._smach_label = label

    def _path(self, label: Optional[str] = None) -> str:
        """Where it (or its child) is, as far as it is known: labels from the outermost container."""
        parent = self._smach_parent() if self._smach_parent is not None else None
        own = parent._path(self._smach_label) if parent is not None else ""
        return own or "/" if label is None else f"{own}/{text_of(label)}"

    # --- callbacks -----------------------------------------------------------------------------------------

    def register_start_cb(self, start_cb: Callable[..., None], cb_args: Iterable[Any] = ()) -> None:
        """Has ``start_cb(userdata, initial_states, *cb_args)`` called when a run begins."""
        self._start_cbs.append((start_cb, list(cb_args)))

    def register_transition_cb(self, transition_cb: Callable[..., None], cb_args: Iterable[Any] = ()) -> None:
        """Has ``transition_cb(userdata, active_states, *cb_args)`` called after each transition."""
        self._transition_cbs.append((transition_cb, list(cb_args)))

    def register_termination_cb(
        self, termination_cb: Callable[..., None], cb_args: Iterable[Any] = ()
    ) -> None:
        """Has ``termination_cb(userdata, terminal_states, outcome, *cb_args)`` called at the end."""
        self._termination_cbs.append((termination_cb, list(cb_args)))

    def unregister_cb(self, cb: Callable[..., None]) -> None:
        """Ends what the three register functions began with this callback. SMACH has no such method."""
        for name in ("_start_cbs", "_transition_cbs", "_termination_cbs"):
            setattr(self, name, [entry for entry in getattr(self, name) if entry[0] != cb])

    def call_start_cbs(self) -> None:
        """Calls the start callbacks."""
        self._call(self._start_cbs, "start", self.get_initial_states)

    def call_transition_cbs(self) -> None:
        """Calls the transition callbacks."""
        self._call(self._transition_cbs, "transition", self.get_active_states)

    def call_termination_cbs(self, terminal_states: List[str], outcome: Optional[str]) -> None:
        """Calls the termination callbacks."""
        self._call(self._termination_cbs, "termination", lambda: terminal_states, outcome)

    def _call(self, cbs: List[_Callback], kind: str, states: Callable[[], List[str]], *args: Any) -> None:
        for cb, cb_args in cbs:
            try:
                cb(self.userdata, list(states()), *args, *cb_args)
            except Exception:
                smach.logerr(
                    f"Container '{self._path()}': a {kind} callback raised an exception; the others are "
                    f"called, the run goes on.\n{traceback.format_exc()}"
                )

    # --- userdata ------------------------------------------------------------------------------------------

    # Containers of users call these two, with both arguments.

    def _copy_input_keys(self, parent_ud: Any, ud: Any) -> None:
        if parent_ud is not None:
            put = functools.partial(ud._put, of_run=True) if isinstance(ud, UserData) else ud.__setitem__
            self._copy(parent_ud, put, self._input_keys, "input")

    def _copy_output_keys(self, ud: Any, parent_ud: Any) -> None:
        if parent_ud is not None:
            self._copy(ud, parent_ud.__setitem__, self._output_keys, "output")

    def _copy(self, source: Any, put: Callable[[str, Any], None], keys: Iterable[str], kind: str) -> None:
        for key in keys:
            try:
                value = source[key]
            except KeyError:
                smach.logwarn(f"Container '{self._path()}': the {kind} key '{key}' has no value to copy")
            else:
                put(key, value)

    def _view(
        self, state: State, remapping: Mapping[str, str], constants: Optional[Mapping[str, Any]] = None
    ) -> Remapper:
        """The userdata as a child sees it."""
        return Remapper(
            self.userdata,
            state.get_registered_input_keys(),
            state.get_registered_output_keys(),
            remapping,
            constants,
        )

    # --- running -------------------------------------------------------------------------------------------

    def execute(self, parent_ud: Any = None) -> Optional[str]:  # type: ignore[override]
        """Executes its children.

        :param parent_ud: userdata that input keys are copied from and output keys to.
        :return: an outcome; None after a shutdown.
        :raises SmachError: the definition is broken, or a child or a callback failed (with its traceback).
        """
        by_container = self._begin_run()
        try:
            self.check_consistency()
            self._copy_input_keys(parent_ud, self.userdata)
            outcome = self._smach_run()
            if outcome is None:
                smach.logdebug(f"{type(self).__name__} '{self._path()}' ends because of a shutdown")
            return outcome
        finally:
            try:
                self._copy_output_keys(self.userdata, parent_ud)
            finally:
                self._end_run(by_container)

    def _smach_run(self) -> Optional[str]:
        """Executes its children, within a run, and calls the callbacks; as :meth:`execute`."""
        raise NotImplementedError(f"{type(self).__name__} does not override execute()")

    def _begin_run(self) -> bool:
        by_container = super()._begin_run()
        self.userdata._begin_run(self.keeps_userdata)
        return by_container

    def _end_run(self, by_container: bool) -> None:
        self.userdata._end_run()
        super()._end_run(by_container)

    def _execute_child(self, label: str, state: State, ud: Any) -> Tuple[Any, bool]:
        """Executes a child in this thread.

        :return: its outcome, None at a shutdown; and whether the container had been preempted by then.
        :raises InvalidUserCodeError: the child raised something.
        :raises InvalidTransitionError: it ended with something else than a registered outcome.
        """
        begin = self._start_child(label, state)
        try:
            outcome = self._run_child(state, begin, ud)
        except InvalidUserCodeError:
            raise
        except Exception as error:
            raise InvalidUserCodeError(
                f"State '{self._path(label)}' of type '{type(state).__name__}' raised "
                f"{type(error).__name__}: {error}\n{traceback.format_exc()}"
            ) from error
        finally:
            with self._smach_lock:
                unserved = self._end_child(label, state)
                preempted = self._preempt_requested
                if unserved is False:
                    self._preempt_requested = False
        return self._registered(label, state, outcome), preempted

    def _registered(self, label: str, state: State, outcome: Any) -> Any:
        """The outcome with which a child has ended, None at a shutdown.

        :raises InvalidTransitionError: the child has not registered it.
        """
        registered = state.get_registered_outcomes()
        if outcome not in registered and not (outcome is None and smach.is_shutdown()):
            raise InvalidTransitionError(
                f"State '{self._path(label)}' of type '{type(state).__name__}' ended with {outcome!r}, "
                f"which is not one of its registered outcomes {list(registered)}"
            )
        return outcome

    def __getstate__(self) -> Dict[str, Any]:
        of_a_run = {name for name in vars(self) if name.startswith("_smach_")} - {"_smach_label"}
        state = {name: value for name, value in vars(self).items() if name not in of_a_run}
        state["_is_running"] = False
        return state

    def __setstate__(self, state: Dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._smach_parent = None
        self._make_lock()
        for label, child in self.get_children().items():
            if isinstance(child, Container):
                child._smach_parent, child._smach_label = weakref.ref(self), label

    def _make_lock(self) -> None:
        super()._make_lock()
        wake_at_shutdown(self._smach_changed)


__all__ = ["Container", "Edge", "names"]

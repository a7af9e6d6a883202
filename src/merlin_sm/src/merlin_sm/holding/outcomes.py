# SPDX-License-Identifier: Apache-2.0
"""With which outcomes the states of one process are left: their own, or what an operator decides.

Pure. An operator may leave a state with one of its registered outcomes: a running one is preempted, and once
it has really ended, its outcome is replaced; one that is held is left without being entered. An outcome that
requires a higher autonomy level than the present one waits until it is confirmed. The preempt of the machine,
a cancel, comes before all of that, as long as the state has not been left.
"""

import threading
import weakref
from typing import Any, Callable, Dict, List, NamedTuple, Optional, Tuple

from merlin_pddl.breakpoints import BreakpointError
from merlin_ros.alarms import wait_ticks
from merlin_ros.work.threads import start_thread
from merlin_sm.autonomy import LEVELS, label_text, read_level
from merlin_sm.holding.state_control import ENDED, HELD, OUT, RUNS, StateControl, Wish
from merlin_sm.holding.state_holds import Pattern, StateHolds, read_state_pattern
from merlin_sm.states.merlin_state import PREEMPTED, MerlinState, merlin_states

REACH_LIMIT = 2.7  # s of wall time in which the preempt of a state has to return, as in a cancel


class NoSuchState(BreakpointError):
    """No machine here has such a state."""


class Left(NamedTuple):
    """How a state was left on which an operator had decided."""

    path: str
    by: str
    """The operator; empty: there was no console."""
    outcome: str
    """The outcome that an operator has asked for."""
    ended: str
    """The state's own outcome; empty: it was not entered."""
    refused: str = ""
    """Why its own outcome is taken after all."""
    unset: Tuple[str, ...] = ()
    """The output keys of the state that nothing has set."""


class Outcomes:
    """What operators decide about the outcomes of the states of one process. Thread-safe.

    :param holds: holds states.
    """

    def __init__(self, holds: StateHolds) -> None:
        self.holds = holds
        self.on_left: Callable[[Left], None] = lambda left: None
        """Called when a state is left on which an operator had decided."""
        self._lock = threading.Lock()  # guards the field below, and of each control what it says
        self._controls: Dict[Pattern, weakref.WeakSet[StateControl]] = {}  # gone with their machines

    # --- for operators ------------------------------------------------------------------------------------

    @property
    def level(self) -> str:
        """The present level; empty: no outcome requires one."""
        with self._lock:
            used = any(control.levels for controls in self._controls.values() for control in controls)
        return LEVELS[self.holds.level] if used else ""

    def set_level(self, text: str) -> None:
        """Sets the level; what waits for a confirmation that is no longer needed is taken.

        :raises ValueError: there is no such level.
        """
        self.holds.set_level(read_level(text))

    def leave(self, path: str, outcome: str, by: str) -> str:
        """A state is to be left with an outcome.

        :param path: of the state: ``NAVIGATE/DRIVE``.
        :param outcome: empty: the one with which it waits is confirmed.
        :param by: the operator.
        :return: what happens now.
        :raises NoSuchState: there is no such state here.
        :raises BreakpointError: it cannot be so.
        """
        labels = read_state_pattern(path)
        with self._lock:
            controls = list(self._controls.get(labels, ()))
            if not controls:
                raise NoSuchState(f"no machine has a state {path}")
            control = _the_active(controls, path)
            stage, outcome = control.stage, outcome or label_text(_confirmed(control))
            known = {label_text(each): each for each in control.state.get_registered_outcomes()}
            if outcome not in known:
                raise BreakpointError(f"{control.path} has no outcome '{outcome}'; it has {', '.join(known)}")
            before, control.wish, control.marked = control.wish, Wish(known[outcome], by), True
            if before is not None:
                control.wish.reached = before.reached  # the last word counts, one preempt is enough
            if control.stage == OUT:  # its run takes no lock to end
                control.wish = None
                raise BreakpointError(f"{control.path} has just been left")
            wish, unset = control.wish, control.unset()
        if stage != RUNS:
            self.holds.release(control.state)
        elif before is None:
            # In a thread of its own: users' code may loop in its preempt.
            start_thread(f"preempt {control.path}", _preempt, control, wish)
        return _said(control.path, stage, outcome, unset)

    # --- for the hook -------------------------------------------------------------------------------------

    def add(self, control: StateControl) -> None:
        """Notes that a state exists."""
        labels = tuple(control.path.upper().split("/"))
        with self._lock:
            self._controls.setdefault(labels, weakref.WeakSet()).add(control)

    def cancel(self, control: StateControl) -> None:
        """A state is preempted by its machine; called before the state is preempted.

        One that is outside counts by its flag: it has just been left, or comes next.
        """
        with self._lock:
            control.cancelled = control.marked = True
            if control.stage == OUT:  # its run takes no lock to end
                control.cancelled = False

    def crashed(self, control: StateControl) -> None:
        """A state has raised an exception."""
        with self._lock:
            wish = self._end(control)
        if wish is not None:
            self._report(control, wish, "", "it has raised an exception")

    def before(self, control: StateControl) -> Optional[str]:
        """Waits where the machine is held before a state.

        :return: the outcome of the state if it is not to be entered.
        """
        with self._lock:
            control.stage = HELD
        preempted = control.state.preempt_requested
        self.holds.wait(
            control.machine, control.state, control.path, lambda: control.wish is not None or preempted()
        )
        with self._lock:
            wish, control.wish = control.wish, None
            cancelled = control.is_cancelled()
            unentered = wish is not None and not cancelled
            control.stage = OUT if unentered else RUNS
        if wish is not None:
            self._report(control, wish, "", "it was cancelled first" if cancelled else "")
        if unentered and wish is not None:
            _note(control.state, wish)
            return wish.outcome
        if preempted() and _ends_unentered(control.state):
            with self._lock:
                self._end(control)
            control.state.service_preempt()
            return PREEMPTED
        return None

    def after(self, control: StateControl, outcome: str) -> str:
        """A state has ended, and there was a wish or a cancel, or not every level is allowed.

        :return: the outcome with which it is left.
        """
        wish = control.wish
        returned = wish is None or wait_ticks(wish.reached.wait, REACH_LIMIT)
        with self._lock:
            # From here on a cancel comes too late for this state: SMACH preempts the next one.
            cancelled = control.is_cancelled()
            wish = self._end(control)
            refused = _refused(control.state, cancelled, returned) if wish is not None else ""
            if wish is not None and not cancelled:
                control.state.service_preempt()  # it was preempted for the wish, not its machine
            waits = not cancelled and control.levels.get(outcome, 0) > self.holds.level
            if waits and (wish is None or refused):
                control.stage, control.outcome = ENDED, outcome
        if wish is not None:
            self._report(control, wish, outcome, refused)
            if not refused:
                _note(control.state, wish)
                return wish.outcome
        return self._wait(control, outcome) if control.stage == ENDED else outcome

    def _wait(self, control: StateControl, outcome: str) -> str:
        """Waits until the outcome of a state may be taken; returns the one with which it is left."""
        followed = self.holds.wait_after(
            control.state,
            control.path,
            label_text(outcome),
            control.levels[outcome],
            lambda: control.wish is not None or control.is_cancelled(),
        )
        with self._lock:
            cancelled = control.is_cancelled() or bool(control.state.preempt_requested())
            wish = self._end(control)
            if cancelled and PREEMPTED in control.state.get_registered_outcomes():
                control.state.service_preempt()
        if not followed:
            self._report(control, Wish(outcome, ""), outcome)
        if wish is not None:
            self._report(control, wish, outcome, "it was cancelled first" if cancelled else "")
        if cancelled and PREEMPTED in control.state.get_registered_outcomes():
            _note(control.state, Wish(PREEMPTED, ""), "cancelled")
            return PREEMPTED
        if wish is None or cancelled:
            return outcome
        if wish.outcome != outcome:
            _note(control.state, wish)
        return wish.outcome

    def _end(self, control: StateControl) -> Optional[Wish]:
        """Ends a state's run for operators; the lock is held."""
        wish, control.wish = control.wish, None
        control.stage, control.outcome = OUT, ""
        control.marked = control.cancelled = False
        return wish

    def _report(self, control: StateControl, wish: Wish, ended: str, refused: str = "") -> None:
        unset = () if refused or wish.outcome == ended else tuple(control.unset())
        texts = label_text(wish.outcome), label_text(ended)
        self.on_left(Left(control.path, wish.by, *texts, refused, unset))


def _the_active(controls: List[StateControl], path: str) -> StateControl:
    """The one that runs, is held or waits."""
    active = [control for control in controls if control.stage != OUT]
    if not active:
        raise BreakpointError(f"{path} neither runs nor is held")
    left = [control for control in active if not control.is_cancelled()]
    if not left:
        raise BreakpointError(f"{path} is being cancelled, which comes first")
    if len(left) > 1:
        raise BreakpointError(f"{path} runs {len(left)} times at once, it is not clear which one is meant")
    return left[0]


def _confirmed(control: StateControl) -> str:
    if control.stage != ENDED:
        raise BreakpointError(f"{control.path} does not wait for a confirmation")
    return control.outcome


def _said(path: str, stage: int, outcome: str, unset: List[str]) -> str:
    how = {
        HELD: f"{path} is left with {outcome}, without being entered.",
        RUNS: f"{path} is preempted; when it has stopped, it is left with {outcome}.",
        ENDED: f"{path} is left with {outcome}.",
    }[stage]
    return f"{how} Nothing has set {', '.join(unset)}." if unset else how


def _preempt(control: StateControl, wish: Wish) -> None:
    try:
        control.request_preempt()
    finally:
        wish.reached.set()


def _refused(state: Any, cancelled: bool, returned: bool) -> str:
    """Why a state that has ended is not left as wished; empty: it is."""
    if cancelled:
        return "it was cancelled first"
    if not returned:
        return f"its preempt did not return within {REACH_LIMIT:g} s"
    inside = [state] if isinstance(state, MerlinState) else _inside(state)
    unstopped = ", ".join(each.unstopped for each in inside if each.unstopped)
    return f"{unstopped} did not stop" if unstopped else ""


def _inside(state: Any) -> List[MerlinState]:
    return list(merlin_states(state)) if hasattr(state, "get_children") else []


def _note(state: Any, wish: Wish, reason: str = "") -> None:
    """Notes in a state of MERLIN with which outcome it was left."""
    if isinstance(state, MerlinState):
        state.outcome = wish.outcome
    if hasattr(state, "reason"):
        state.given_up, state.about = False, ""
        state.reason = reason or f"forced by {wish.by}"


def _ends_unentered(state: Any) -> bool:
    """Whether a state that was preempted before it began is not begun: those of MERLIN look themselves."""
    return not isinstance(state, MerlinState) and PREEMPTED in state.get_registered_outcomes()

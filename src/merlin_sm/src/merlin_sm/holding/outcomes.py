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
from merlin_sm.autonomy import LEVELS, label_text, read_level
from merlin_sm.holding.seat import ENDED, HELD, OUT, RUNS, Seat, Wish
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
        self._lock = threading.Lock()  # guards the field below, and of each seat what it says
        self._seats: Dict[Pattern, weakref.WeakSet[Seat]] = {}  # gone with their machines

    # --- for operators ------------------------------------------------------------------------------------

    @property
    def level(self) -> str:
        """The present level; empty: no outcome requires one."""
        with self._lock:
            used = any(seat.levels for seats in self._seats.values() for seat in seats)
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
            seats = list(self._seats.get(labels, ()))
            if not seats:
                raise NoSuchState(f"no machine has a state {path}")
            seat = _the_active(seats, path)
            stage, outcome = seat.stage, outcome or label_text(_confirmed(seat))
            known = {label_text(each): each for each in seat.state.get_registered_outcomes()}
            if outcome not in known:
                raise BreakpointError(f"{seat.path} has no outcome '{outcome}'; it has {', '.join(known)}")
            before, seat.wish, seat.marked = seat.wish, Wish(known[outcome], by), True
            if before is not None:
                seat.wish.reached = before.reached  # the last word counts, one preempt is enough
            if seat.stage == OUT:  # its run takes no lock to end
                seat.wish = None
                raise BreakpointError(f"{seat.path} has just been left")
            wish, unset = seat.wish, seat.unset()
        if stage != RUNS:
            self.holds.release(seat.state)
        elif before is None:
            # In a thread of its own: users' code may loop in its preempt.
            threading.Thread(
                target=_preempt, args=(seat, wish), name=f"preempt {seat.path}", daemon=True
            ).start()
        return _said(seat.path, stage, outcome, unset)

    # --- for the gate -------------------------------------------------------------------------------------

    def add(self, seat: Seat) -> None:
        """Notes that a state exists."""
        labels = tuple(seat.path.upper().split("/"))
        with self._lock:
            self._seats.setdefault(labels, weakref.WeakSet()).add(seat)

    def begin(self, seats: List[Seat]) -> None:
        """A run of a machine begins: what came too late for the last one is forgotten."""
        with self._lock:
            for seat in seats:
                seat.cancelled = False

    def cancel(self, seat: Seat) -> None:
        """A state is preempted by its machine; called before the state is preempted."""
        with self._lock:
            seat.cancelled = seat.marked = True

    def crashed(self, seat: Seat) -> None:
        """A state has raised an exception."""
        with self._lock:
            wish = self._end(seat)
        if wish is not None:
            self._report(seat, wish, "", "it has raised an exception")

    def before(self, seat: Seat) -> Optional[str]:
        """Waits where the machine is held before a state.

        :return: the outcome of the state if it is not to be entered.
        """
        with self._lock:
            seat.stage = HELD
        preempted = seat.state.preempt_requested
        self.holds.wait(seat.machine, seat.state, seat.path, lambda: seat.wish is not None or preempted())
        with self._lock:
            wish, seat.wish = seat.wish, None
            cancelled = seat.is_cancelled()
            unentered = wish is not None and not cancelled
            seat.stage = OUT if unentered else RUNS
        if wish is not None:
            self._report(seat, wish, "", "it was cancelled first" if cancelled else "")
        if unentered and wish is not None:
            _note(seat.state, wish)
            return wish.outcome
        if preempted() and _ends_unentered(seat.state):
            seat.stage = OUT
            seat.state.service_preempt()
            return PREEMPTED
        return None

    def after(self, seat: Seat, outcome: str) -> str:
        """A state has ended, and there was a wish or a cancel, or not every level is allowed.

        :return: the outcome with which it is left.
        """
        wish = seat.wish
        returned = wish is None or wait_ticks(wish.reached.wait, REACH_LIMIT)
        with self._lock:
            # From here on a cancel comes too late for this state: SMACH preempts the next one.
            cancelled = seat.is_cancelled()
            wish = self._end(seat)
            refused = _refused(seat.state, cancelled, returned) if wish is not None else ""
            if wish is not None and not cancelled:
                seat.state.service_preempt()  # it was preempted for the wish, not its machine
            waits = not cancelled and seat.levels.get(outcome, 0) > self.holds.level
            if waits and (wish is None or refused):
                seat.stage, seat.outcome = ENDED, outcome
        if wish is not None:
            self._report(seat, wish, outcome, refused)
            if not refused:
                _note(seat.state, wish)
                return wish.outcome
        return self._wait(seat, outcome) if seat.stage == ENDED else outcome

    def _wait(self, seat: Seat, outcome: str) -> str:
        """Waits until the outcome of a state may be taken; returns the one with which it is left."""
        followed = self.holds.wait_after(
            seat.state,
            seat.path,
            label_text(outcome),
            seat.levels[outcome],
            lambda: seat.wish is not None or seat.is_cancelled(),
        )
        with self._lock:
            cancelled = seat.is_cancelled() or bool(seat.state.preempt_requested())
            wish = self._end(seat)
            if cancelled and PREEMPTED in seat.state.get_registered_outcomes():
                seat.state.service_preempt()
        if not followed:
            self._report(seat, Wish(outcome, ""), outcome)
        if wish is not None:
            self._report(seat, wish, outcome, "it was cancelled first" if cancelled else "")
        if cancelled and PREEMPTED in seat.state.get_registered_outcomes():
            _note(seat.state, Wish(PREEMPTED, ""), "cancelled")
            return PREEMPTED
        if wish is None or cancelled:
            return outcome
        if wish.outcome != outcome:
            _note(seat.state, wish)
        return wish.outcome

    def _end(self, seat: Seat) -> Optional[Wish]:
        """Ends a state's run for operators; the lock is held."""
        wish, seat.wish = seat.wish, None
        seat.stage, seat.outcome = OUT, ""
        seat.marked = seat.cancelled = False
        return wish

    def _report(self, seat: Seat, wish: Wish, ended: str, refused: str = "") -> None:
        unset = () if refused or wish.outcome == ended else tuple(seat.unset())
        texts = label_text(wish.outcome), label_text(ended)
        self.on_left(Left(seat.path, wish.by, *texts, refused, unset))


def _the_active(seats: List[Seat], path: str) -> Seat:
    """The one that runs, is held or waits."""
    active = [seat for seat in seats if seat.stage != OUT]
    if not active:
        raise BreakpointError(f"{path} neither runs nor is held")
    left = [seat for seat in active if not seat.is_cancelled()]
    if not left:
        raise BreakpointError(f"{path} is being cancelled, which comes first")
    if len(left) > 1:
        raise BreakpointError(f"{path} runs {len(left)} times at once, it is not clear which one is meant")
    return left[0]


def _confirmed(seat: Seat) -> str:
    if seat.stage != ENDED:
        raise BreakpointError(f"{seat.path} does not wait for a confirmation")
    return seat.outcome


def _said(path: str, stage: int, outcome: str, unset: List[str]) -> str:
    how = {
        HELD: f"{path} is left with {outcome}, without being entered.",
        RUNS: f"{path} is preempted; when it has stopped, it is left with {outcome}.",
        ENDED: f"{path} is left with {outcome}.",
    }[stage]
    return f"{how} Nothing has set {', '.join(unset)}." if unset else how


def _preempt(seat: Seat, wish: Wish) -> None:
    try:
        seat.request_preempt()
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
        state.outcome, state.given_up, state.about = wish.outcome, False, ""
    if hasattr(state, "reason"):
        state.reason = reason or f"forced by {wish.by}"


def _ends_unentered(state: Any) -> bool:
    """Whether a state that was preempted before it began is not begun: those of MERLIN look themselves."""
    return not isinstance(state, MerlinState) and PREEMPTED in state.get_registered_outcomes()

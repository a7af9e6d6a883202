# SPDX-License-Identifier: Apache-2.0
"""Where the machines of one process are held: before states (breakpoints), and behind them (autonomy levels).

Pure. The process owns its breakpoints and its level. A hold before a state ends with a step or a continue,
one behind it with a confirmation or a higher level. Both end with the preempt of the state, the end of the
process, and by themselves when no console has followed them for :data:`GRACE`: nothing is held forever.
"""

import re
import threading
import time
from typing import Callable, Dict, List, Optional, Sequence, Set, Tuple

from merlin_pddl.breakpoints import LONGEST, MOST, BreakpointError, fits
from merlin_sm.autonomy import FULL, LEVELS
from merlin_sm.holding.state_control import Machine

HEARTBEAT = 1.0  # s between two calls of `on_change` while something is held
GRACE = 30.0  # s of wall time without a console, after which what is held continues
_LABEL = re.compile(r"[^()/]+\Z")
Pattern = Tuple[str, ...]


def names_state(text: str) -> bool:
    """Whether a breakpoint is one on a state, ``NAVIGATE/DRIVE``, and not on an action or a goal."""
    return "/" in text and "(" not in text


def read_state_pattern(text: str) -> Pattern:
    """The labels of a breakpoint: ``NAVIGATE/DRIVE``, ``ASK/*``.

    :raises BreakpointError: it is something else.
    """
    labels = tuple(label.strip().upper() for label in text.strip().strip("/").split("/"))
    if len(labels) < 2 or len(text) > LONGEST or not all(map(_LABEL.match, labels)):
        shown = text if len(text) <= 60 else f"{text[:57]}..."
        raise BreakpointError(f"'{shown}' is not a state; write its machine and label, like NAVIGATE/DRIVE")
    return labels


class _Held:
    """A state that is held.

    :param machine: before a state of it; None: behind one.
    :param outcome: with which the state has ended; empty: it is held before it.
    :param required: the level of that outcome.
    """

    def __init__(
        self,
        machine: Optional[Machine],
        state: object,
        path: str,
        since: float,
        outcome: str = "",
        required: int = 0,
    ) -> None:
        self.machine, self.state, self.path, self.since = machine, state, path, since
        self.outcome, self.required = outcome, required
        self.lost = False  # it continues as there is no console


class StateHolds:
    """The breakpoints of one process, and what they hold. Thread-safe.

    :param clock: s of wall time.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.armed = False
        """Whether anything may be held; without it nothing else needs to be asked before a state."""
        self.limited = False
        """Whether the level is below ``full``; without it no outcome waits."""
        self.on_change: Callable[[], None] = lambda: None
        """Called after each change of what is held, and once per :data:`HEARTBEAT` while something is."""
        self.on_lost: Callable[[str], None] = lambda text: None
        """Called with a sentence when what is held continues because there is no console."""
        self._clock = clock
        self._changed = threading.Condition()  # guards the fields below, and changes of those above
        self.level = self._usual = FULL
        """The place of the autonomy level in :data:`~merlin_sm.autonomy.LEVELS`."""
        self._paths: Dict[str, List[Pattern]] = {}  # of the states of each machine
        self._patterns: Dict[Pattern, str] = {}
        self._held: List[_Held] = []
        self._stepping: Set[Machine] = set()
        self._followed = clock()

    @property
    def texts(self) -> List[str]:
        """The breakpoints as they were given."""
        with self._changed:
            return list(self._patterns.values())

    @property
    def waiting(self) -> List[str]:
        """The states before which machines are held now, in the order in which they came."""
        with self._changed:
            return [held.path for held in self._held if not held.outcome]

    @property
    def unconfirmed(self) -> List[Tuple[str, str]]:
        """The states that wait for a confirmation, each with its outcome, in the order of their coming."""
        with self._changed:
            return [(held.path, held.outcome) for held in self._held if held.outcome]

    @property
    def held(self) -> str:
        """What is held, as text; empty: nothing."""
        return ", ".join(self.waiting)

    def declare(self, name: str, paths: Sequence[str]) -> None:
        """Adds a machine with these states, in place of an earlier one of that name."""
        with self._changed:
            self._paths[name] = [tuple(path.upper().split("/")) for path in paths]

    def set(self, texts: Sequence[str]) -> None:
        """Replaces the breakpoints by those that some machine here has; what is held stays so.

        :raises BreakpointError: when one is not a state, or they are too many; the old ones stay.
        """
        if len(texts) > MOST:
            raise BreakpointError(f"there can be {MOST} breakpoints at most")
        found = {read_state_pattern(text): text.strip() for text in texts}
        with self._changed:
            known = [path for paths in self._paths.values() for path in paths]
            self._patterns = {
                pattern: text for pattern, text in found.items() if any(fits(pattern, path) for path in known)
            }
            self._arm()

    def set_level(self, level: int, usual: bool = False) -> None:
        """Sets the autonomy level; outcomes that it allows no longer wait.

        :param usual: it is the one to which the level goes back when there is no console.
        """
        with self._changed:
            self.level = level
            if usual:
                self._usual = level
            self._held = [held for held in self._held if not held.outcome or held.required > level]
            self._arm()
            self._changed.notify_all()
        self.on_change()

    def step(self) -> None:
        """What is held enters its state; the next state of the same machine is held, unless its run ends."""
        self._release(True)

    def go_on(self) -> None:
        """What is held enters its state, and runs up to the next breakpoint."""
        self._release(False)

    def followed(self) -> None:
        """A console shows what is held: it may stay held."""
        with self._changed:
            self._followed = self._clock()

    def wait(self, machine: Machine, state: object, path: str, over: Callable[[], bool]) -> None:
        """Waits as long as a machine is held before a state; not at all when it is not.

        :param state: :meth:`release` of which ends the wait.
        :param path: of the state.
        :param over: whether it was released already.
        """
        with self._changed:
            stepping = machine in self._stepping
            self._stepping.discard(machine)
            labels = tuple(path.upper().split("/"))
            if not stepping and not any(fits(pattern, labels) for pattern in self._patterns):
                self._arm()
                return
            held = self._hold(_Held(machine, state, path, self._clock()))
        self._wait(held, over)

    def wait_after(
        self, state: object, path: str, outcome: str, required: int, over: Callable[[], bool]
    ) -> bool:
        """Waits until a state may be left with the outcome with which it has ended.

        :param state: :meth:`release` of which ends the wait.
        :param path: of the state.
        :param outcome: with which it has ended.
        :param required: the level at which it may be left by itself.
        :param over: whether it was released already.
        :return: False: it may be left because there is no console.
        """
        with self._changed:
            if required <= self.level:
                return True
            held = self._hold(_Held(None, state, path, self._clock(), outcome, required))
        self._wait(held, over)
        return not held.lost

    def release(self, state: object) -> None:
        """A state is no longer held; `over` of its wait has to be true before."""
        with self._changed:
            self._held = [held for held in self._held if held.state is not state]
            self._arm()
            self._changed.notify_all()

    def end_step(self, machine: Machine) -> None:
        """A run of a machine begins or has ended: a step of it does not continue."""
        if self.armed:
            with self._changed:
                self._stepping.discard(machine)
                self._arm()

    def _hold(self, held: _Held) -> _Held:
        self._held.append(held)
        self._arm()
        return held

    def _wait(self, held: _Held, over: Callable[[], bool]) -> None:
        if over():
            self.release(held.state)
        try:
            while not self._released(held):
                self.on_change()
                with self._changed:
                    self._changed.wait_for(lambda: held not in self._held, HEARTBEAT)
        finally:
            self._drop(held)
        self.on_change()

    def _released(self, held: _Held) -> bool:
        with self._changed:
            if held not in self._held:
                return True
            if self._clock() - max(self._followed, held.since) <= GRACE:
                return False
            paths = ", ".join(each.path for each in self._held)
            for each in self._held:
                each.lost = True
            self._patterns, self._held, self.level = {}, [], self._usual
            self._stepping.clear()
            self._arm()
            self._changed.notify_all()
        kept = f"no more breakpoints, the autonomy level is {LEVELS[self._usual]}"
        self.on_lost(f"no console for {GRACE:g} s: {paths} goes on, and there are {kept}")
        return True

    def _drop(self, held: _Held) -> None:
        with self._changed:
            if held in self._held:
                self._held.remove(held)
            self._arm()

    def _release(self, stepping: bool) -> None:
        with self._changed:
            before = [held for held in self._held if not held.outcome]
            self._stepping = {held.machine for held in before if held.machine} if stepping else set()
            self._held = [held for held in self._held if held.outcome]
            self._arm()
            self._changed.notify_all()

    def _arm(self) -> None:
        self.armed = bool(self._patterns or self._stepping or self._held)
        self.limited = self.level < FULL

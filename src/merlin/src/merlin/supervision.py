# SPDX-License-Identifier: Apache-2.0
"""Starts a run again that was killed, and makes sure that no process is left behind.

The run itself is a child of this process, which does nothing but wait for it: what kills the run, as the
kernel does when memory is short, leaves this one. Linux gives a process whose parent died to the nearest
ancestor that asked for it; run and supervisor ask. So at the end everything that is left is a child, and can
be ended without guessing by name.
"""

import contextlib
import mmap
import os
import signal
import sys
import time
from typing import Callable, List, Optional, Set, Tuple

from merlin_ros.alarms import TICK, TickClock
from merlin_ros.processes.process_tree import adopt_orphans, children, end_with
from merlin_ros.processes.tidy_end import signal_name
from merlin_ros.work.threads import start_thread

SI_KERNEL = 0x80

#: Pauses before the 1st, 2nd, … start within the span, s.
PAUSES = (0.1, 0.5, 1.0, 2.0, 4.0)
#: s within which the script `respawn`, when it is killed, is started again once for each of the pauses.
WRAPPER_SPAN = 30.0
#: The same for a whole run, which takes a while to come up.
RUN_SPAN = 300.0
#: s for the nodes of a run that was killed to end in order: they brake the base and close their files.
END_LIMIT = 10.0
#: s for what was killed to be gone.
KILL_LIMIT = 5.0

_ENDS: Set[int] = {signal.SIGINT, signal.SIGTERM, signal.SIGHUP}
_CHILD: Set[int] = {signal.SIGCHLD}


class Restarts:
    """How often something that dies is started again.

    :param span: s within which it may be started once for each of :data:`PAUSES`.
    :param clock: s, never set back.
    """

    def __init__(self, span: float, clock: Callable[[], float] = time.monotonic) -> None:
        self.span = span
        self._clock = clock
        self._deaths: List[float] = []

    def died(self) -> Optional[float]:
        """It has died: s until it is started again; None: it has died too often."""
        now = self._clock()
        self._deaths = [death for death in self._deaths if now - death < self.span] + [now]
        return PAUSES[self.count - 1] if self.count <= len(PAUSES) else None

    @property
    def count(self) -> int:
        """Deaths within the span that ends with the last one."""
        return len(self._deaths)

    @property
    def words(self) -> str:
        """What follows from the last death, as the end of a sentence."""
        if self.count > len(PAUSES):
            return f"for the {self.count}th time within {self.span:g} s; it is not started again"
        return f"it is started again, {self.count} of {len(PAUSES)} times within {self.span:g} s"


def supervise(run: Callable[[bool, Callable[[], None]], int], command: str) -> int:
    """Carries out a run in a child process, and starts it again when that is killed.

    Call it before anything of ROS is imported, in a process with one thread.

    :param run: what the child does: whether it was started before, and a function to call as soon as the run
        ends by itself; returns the exit code.
    :param command: that the user has given, for messages.
    :return: the exit code of the run; 128 + signal when a signal has ended it for good.
    """
    adopt_orphans()
    signal.signal(signal.SIGCHLD, lambda *_: None)  # where the parent ignores it, no end is reported
    signal.pthread_sigmask(signal.SIG_BLOCK, _ENDS | _CHILD)
    ended = mmap.mmap(-1, 1)  # shared with the run: 1 from where it is not started again on

    def ends() -> None:
        ended[0] = 1

    restarts, again = Restarts(RUN_SPAN), False
    while True:
        supervisor = os.getpid()
        child = os.fork()
        if child == 0:
            if not end_with(supervisor, signal.SIGTERM):  # so it ends in order when that is killed
                raise SystemExit(128 + signal.SIGTERM)
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            signal.pthread_sigmask(signal.SIG_UNBLOCK, _ENDS | _CHILD)
            return run(again, ends)
        code, stopped = _await(child)
        if code >= 0:
            end_children()
            return code
        if stopped or -code in _ENDS or ended[0]:
            _end_in_order()
            return 128 - code
        pause = restarts.died()
        name = signal_name(-code)
        print(
            f"{command}: the run was killed ({name}), its nodes are ended; {restarts.words}", file=sys.stderr
        )
        stopped = _end_in_order()
        if pause is None:
            return 128 - code
        waited = None if stopped else signal.sigtimedwait(_ENDS, pause)
        stopped = waited.si_signo if waited is not None else stopped
        if stopped:
            return 128 + stopped
        again = True


def _await(child: int) -> Tuple[int, int]:
    """Waits for the end of a child and passes on what is to end it.

    :return: its exit code, negative for a signal; and the signal that this process got, or 0.
    """
    stopped = 0
    while True:
        process, status = os.waitpid(child, os.WNOHANG)
        if process:
            return -os.WTERMSIG(status) if os.WIFSIGNALED(status) else os.WEXITSTATUS(status), stopped
        received = signal.sigwaitinfo(_ENDS | _CHILD)
        if received.si_signo in _ENDS:
            stopped = received.si_signo
            if received.si_code != SI_KERNEL:  # that of a terminal has reached the child, too
                os.kill(child, stopped)


def _end_in_order() -> int:
    """Ends the nodes of a run that is dead; returns the signal that this process got meanwhile, or 0."""
    stopped, ticks = 0, TickClock()  # a stall of this process is none of theirs
    for process in children():
        with contextlib.suppress(OSError):
            os.kill(process, signal.SIGINT)
    while True:
        with contextlib.suppress(ChildProcessError):
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass
        if not children() or ticks.now >= END_LIMIT:
            break
        received = signal.sigtimedwait(_ENDS | _CHILD, TICK)
        ticks.look()
        if received is not None and received.si_signo in _ENDS:
            stopped = received.si_signo
    end_children()
    return stopped


def end_children(limit: float = KILL_LIMIT) -> List[int]:
    """Kills and reaps all children of this process, and theirs as they are adopted.

    One that does not end is named, and left.

    :param limit: s of running time for those that are there at the same time.
    :return: the ids of those that were still running.
    """
    killed: List[int] = []
    hung: Set[int] = set()
    while True:
        found = [process for process in children() if process not in hung]
        if not found:
            return killed
        running = [process for process in found if not _reap(process, os.WNOHANG)]
        for process in running:
            with contextlib.suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)
        killed += running
        ends = [start_thread(f"end of {process}", _reap, process) for process in running]
        ticks = TickClock()  # as above
        for process, end in zip(running, ends):
            while end.is_alive() and ticks.now < limit:
                end.join(TICK)
                ticks.look()
            if end.is_alive():
                hung.add(process)
                why = "it hangs in the kernel, or a debugger holds it"
                print(f"process {process} was killed and does not end: {why}", file=sys.stderr, flush=True)


def _reap(process: int, options: int = 0) -> bool:
    """Whether a child has ended; it is reaped then."""
    try:
        return os.waitpid(process, options)[0] != 0
    except ChildProcessError:  # another thread has reaped it
        return True


def main() -> int:
    """Entry point of `rosrun merlin run`."""

    def run(again: bool, ends: Callable[[], None]) -> int:
        from merlin.launch_runner import main as run_launch

        return run_launch(again, ends)

    return supervise(run, "merlin run")

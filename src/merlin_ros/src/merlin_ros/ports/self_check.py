# SPDX-License-Identifier: Apache-2.0
"""A node's look at itself: whether its ports answer, its timer runs, and whether it has lost a thread.

Others see such a node live. It ends, so that what started it starts it again.
"""

import errno
import select
import socket
import threading
import time
from typing import Any, Callable, NamedTuple, Sequence

import rosgraph.network

from merlin_ros.alarms import LONGEST_TICK, TICK, TickClock, call_later
from merlin_ros.ports.entrance import Greeting
from merlin_ros.work.threads import start_thread

#: Between two looks, s of wall time.
PERIOD = 2.0
#: Longest wait for an answer, s of looks in time.
ANSWER = 1.0
#: Looks without an answer, one after the other, after which a port counts as deaf.
PATIENCE = 3

_SHORTAGE = (errno.EMFILE, errno.ENFILE)
#: Other errors are of the network below, and say nothing of the port.
_DEAF = (*_SHORTAGE, errno.ECONNREFUSED, errno.ECONNRESET, errno.EPIPE, errno.ENOBUFS, errno.ENOMEM)


class Port(NamedTuple):
    """A port of this process: its name for texts, its number, and a question that it answers."""

    name: str
    number: int
    question: bytes


class SelfCheck:
    """Looks at this process once per period, in a thread of its own.

    :param ports: gives the ports that are open now.
    :param end: called once, with the reason, when the process cannot go on as it is: its ports are deaf, its
        timer stands, or all answer but a thread was lost before. Not earlier: what was short would keep it
        from being started again. Must need neither a thread nor a descriptor.
    :param clock: of the waits for an answer, s.
    """

    def __init__(
        self,
        ports: Callable[[], Sequence[Port]],
        end: Callable[[str], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._ports, self._end, self._clock = ports, end, clock
        self._stopped = threading.Event()
        self._lost = ""  # which thread, and why; written by any thread, the first one stays

    def start(self) -> None:
        """Begins to look, and to notice threads that do not start, or die for want of a descriptor."""
        start_thread("self-check", self._work)
        starts, reports = threading.Thread.start, threading.excepthook

        def start(thread: threading.Thread) -> None:
            try:
                starts(thread)
            except RuntimeError as error:
                # Whoever starts a thread counts on it, rospy included. (One that has run cannot run again.)
                if thread.ident is None and not isinstance(thread, Greeting):
                    lose(thread, "could not be started", error)
                raise

        def report(fault: Any) -> None:
            reports(fault)
            if getattr(fault.exc_value, "errno", None) in _SHORTAGE:
                lose(fault.thread, "has died", fault.exc_value)

        def lose(thread: Any, how: str, error: BaseException) -> None:
            self._lost = self._lost or f"the thread '{getattr(thread, 'name', None)}' {how}: {error}"

        threading.Thread.start, threading.excepthook = start, report  # type: ignore

    def stop(self) -> None:
        """Ends the thread that looks."""
        self._stopped.set()

    def _work(self) -> None:
        deaf = 0
        while not self._stopped.wait(PERIOD):
            faults = list(filter(None, [*map(self._ask, self._ports()), self._ask_timer()]))
            if self._stopped.is_set():
                return
            deaf = deaf + 1 if faults else 0
            if deaf == PATIENCE or (self._lost and not faults):
                self._end(faults[0] if faults else self._lost)
                return

    def _comes(self, attempt: Callable[[float], bool]) -> bool:
        """Waits for an answer, or for the end of this check.

        What makes a look late, want of a processor or of the interpreter, holds up each step of the answer
        likewise: the later a look, the less it counts.
        """
        ticks, counted = TickClock(self._clock), 0.0
        while not attempt(TICK) and not self._stopped.is_set():
            counted += LONGEST_TICK - ticks.look()
            if counted >= ANSWER:
                return False
        return True

    def _ask_timer(self) -> str:
        rang = threading.Event()
        call_later(0.0, rang.set)
        return "" if self._comes(rang.wait) else "its timer stands: a call of it does not return"

    def _ask(self, port: Port) -> str:
        """Asks a port; returns why it gave no answer, or nothing."""
        answer, fault = select.poll(), "it is silent"
        try:
            host = "::1" if rosgraph.network.use_ipv6() else "127.0.0.1"
            with socket.create_connection((host, port.number), ANSWER) as connection:
                connection.sendall(port.question)
                answer.register(connection, select.POLLIN)
                if self._comes(lambda s: bool(answer.poll(1000 * s))):
                    if self._stopped.is_set() or connection.recv(1):
                        return ""
                    fault = "it closes connections"
        except socket.timeout:
            fault = "it takes no connection"
        except OSError as error:
            if error.errno not in _DEAF:
                return ""
            fault = str(error)
        return f"its port {port.number} ({port.name}) gives no answer: {fault}"

# SPDX-License-Identifier: Apache-2.0
"""A node's look at itself: whether its ports answer, its timer runs, and whether it has lost a thread.

Others see such a node live. It ends, so that what started it starts it again.
"""

import errno
import select
import socket
import threading
from typing import Any, Callable, NamedTuple, Sequence

import rosgraph.network

from merlin_ros.alarms import call_later, wait_ticks
from merlin_ros.ports.entrance import Greeting
from merlin_ros.work.threads import start_thread

#: Between two looks, s of wall time.
PERIOD = 2.0
#: Longest wait for an answer, s of this process's own ticks.
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
    """

    def __init__(self, ports: Callable[[], Sequence[Port]], end: Callable[[str], None]) -> None:
        self._ports, self._end = ports, end
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

    def _ask_timer(self) -> str:
        rang = threading.Event()
        call_later(0.0, rang.set)
        rings = wait_ticks(lambda s: rang.wait(s) or self._stopped.is_set(), ANSWER)
        return "" if rings else "its timer stands: a call of it does not return"

    def _ask(self, port: Port) -> str:
        """Asks a port; returns why it gave no answer, or nothing."""
        answer, fault = select.poll(), "it is silent"
        try:
            host = "::1" if rosgraph.network.use_ipv6() else "127.0.0.1"
            with socket.create_connection((host, port.number), ANSWER) as connection:
                connection.sendall(port.question)
                answer.register(connection, select.POLLIN)
                if wait_ticks(lambda s: bool(answer.poll(1000 * s)) or self._stopped.is_set(), ANSWER):
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

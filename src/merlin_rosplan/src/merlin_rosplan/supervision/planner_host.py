# SPDX-License-Identifier: Apache-2.0
"""The node's end of a supervising process (:mod:`merlin_rosplan.supervision.planner_supervisor`)."""

import contextlib
import json
import os
import select
import threading
from functools import partial
from typing import Any, Dict, List, Optional

from merlin_ros.alarms import TICK, TickClock, call_later
from merlin_ros.processes.child_process import ChildProcess
from merlin_ros.work.threads import start_thread

#: s within which a cancel is answered even when the supervising process does not answer
CANCEL_LIMIT = 1.0
_MODULE = "merlin_rosplan.supervision.planner_supervisor"


class HostError(RuntimeError):
    """The supervising process cannot be started, or has ended; the text says what to do."""


class PlannerHost:
    """A supervising process that does one planning at a time. It ends with this process, however that ends.

    :param niceness: nice value of it and of what plans; 0: that of this process.
    :raises HostError: it cannot be started.
    """

    def __init__(self, niceness: int = 0) -> None:
        environment = dict(os.environ)
        if environment.pop("RESPAWN_TUNED", ""):  # by scripts/respawn: it would slow down a search
            environment.pop("GLIBC_TUNABLES", "")
        try:
            self._process = ChildProcess(_MODULE, str(niceness), environment=environment)
        except OSError as error:
            raise HostError(f"the planner's supervising process cannot be started: {error}") from error
        self._channel = self._process.channel
        self._lock = threading.Lock()  # guards the two fields below
        self._number = 0
        self._running = False
        self._received = b""
        self._lost = threading.Event()

    @property
    def pid(self) -> int:
        """Process id of the host."""
        return self._process.pid

    @property
    def alive(self) -> bool:
        """Whether it answers; its socket closes before its end can be seen."""
        return not self._lost.is_set() and self._process.alive

    def begin(self, job: Dict[str, Any]) -> None:
        """Begins a planning; :meth:`wait` follows.

        :raises HostError: the process has ended.
        """
        with self._lock:
            self._number += 1
            self._running = True
            self._send({**job, "job": self._number})

    def cancel(self) -> None:
        """Ends the planning that runs; without effect when none does."""
        with self._lock:
            if not self._running:
                return
            number = self._number
            with contextlib.suppress(HostError):
                self._send({"cancel": number})
        # In a thread of its own: the lock is held while a supervising process that hangs is sent something.
        call_later(CANCEL_LIMIT, partial(start_thread, "planner cancel", self._give_up, number))

    def wait(self, limit: Optional[float] = None) -> Dict[str, Any]:
        """How the planning ended.

        :param limit: s for the answer, which a stall of this process does not use up; None: as long as the
            supervising process lives.
        :raises HostError: the process ended instead, or hangs.
        """
        ticks = TickClock()
        try:
            while True:
                *lines, self._received = (self._received + self._receive(limit, ticks)).split(b"\n")
                for line in lines:
                    answer: Dict[str, Any] = json.loads(line)
                    if answer["job"] == self._number:
                        return answer
        finally:
            with self._lock:
                self._running = False

    def close(self) -> None:
        """Ends the process and everything below it."""
        self._channel.close()
        self._process.wait(CANCEL_LIMIT)

    def _receive(self, limit: Optional[float], ticks: TickClock) -> bytes:
        poll = select.poll()
        poll.register(self._channel, select.POLLIN)
        while limit is not None and not poll.poll(1000.0 * max(0.0, min(limit - ticks.now, TICK))):
            ticks.look()
            if ticks.now >= limit:
                self._lost.set()
                raise HostError(
                    f"the planner's supervising process {self.pid} does not answer: it hangs; another one is "
                    "started for the next planning"
                )
        try:
            received = self._channel.recv(65536)
        except OSError:
            received = b""
        if not received:
            self._lost.set()
            raise HostError(
                "the planner's supervising process has ended; it is started again for the next planning "
                "(was it killed, or is the memory full?)"
            )
        return received

    def _send(self, message: Dict[str, Any]) -> None:
        try:
            self._channel.sendall(json.dumps(message).encode() + b"\n")
        except OSError as error:
            self._lost.set()
            raise HostError(f"the planner's supervising process does not listen: {error}") from error

    def _give_up(self, number: int) -> None:
        with self._lock:
            if self._running and self._number == number:
                # Its end of the socket closes too: should it come to itself, it ends what it has started.
                self._process.interrupt()


class PlannerHosts:
    """Supervising processes that are kept between plannings: as many as plan at a time, usually one.

    :param niceness: see :class:`PlannerHost`.
    """

    def __init__(self, niceness: int = 0) -> None:
        self._niceness = niceness
        self._lock = threading.Lock()  # guards the field below
        self._idle: List[PlannerHost] = []

    def warm_up(self) -> None:
        """Starts one in advance; returns before it is ready.

        :raises HostError: it cannot be started.
        """
        self.give_back(self.take())

    def take(self) -> PlannerHost:
        """One that is idle.

        :raises HostError: none can be started.
        """
        with self._lock:
            while self._idle:
                host = self._idle.pop()
                if host.alive:
                    return host
                host.close()
        return PlannerHost(self._niceness)

    def give_back(self, host: PlannerHost) -> None:
        """Keeps one for the next planning, if it still answers."""
        if not host.alive:
            host.close()
            return
        with self._lock:
            self._idle.append(host)


#: Those of this process.
HOSTS = PlannerHosts()

# SPDX-License-Identifier: Apache-2.0
"""Strokes on what is around the nodes: the link, the clocks, the disk, a second node, one that dies again."""

import signal
import threading
import time
from typing import List

from chaos.faults import Fault
from chaos.judging import events
from chaos.judging.events import Event
from chaos.striking.stroke import Stroke
from chaos.under_test import processes
from chaos.under_test.system import System

#: The file that fills the disk.
BALLAST = "ballast"
CHUNK = b"\0" * 4096
#: Facts that the client writes to the knowledge base while its disk is full, until one is refused.
WRITTEN_FACTS = tuple(f"(noted f{number})" for number in range(20))
#: s between two looks whether a killed node is back.
LOOK = 0.05


class Link(Stroke):
    """The link between robot and mind is cut, lossy or slow."""

    def strike(self) -> None:
        """Shapes it."""
        self._system.network.shape(self._fault.loss, self._fault.delay)

    def help(self) -> List[str]:
        """Heals it."""
        self.end()
        return ["link healed"]

    def end(self) -> None:
        """Heals it."""
        self._system.network.shape()


class ClockBack(Stroke):
    """The simulator sets its clock back."""

    def strike(self) -> None:
        """Asks for it."""
        self._system.tell_client(do="clock_back")


class SecondClock(Stroke):
    """For a second there are two clocks."""

    def strike(self) -> None:
        """Has the client publish one."""
        self._system.tell_client(do="second_clock")


class DiskFull(Stroke):
    """The file system of the state file is full, and the client writes."""

    def strike(self) -> None:
        """Fills it."""
        with (self._system.disk / BALLAST).open("wb", buffering=0) as ballast:
            try:
                while True:
                    ballast.write(CHUNK)
            except OSError:
                pass  # it is full
        self._system.tell_client(do="write", facts=list(WRITTEN_FACTS))

    def end(self) -> None:
        """Makes room."""
        (self._system.disk / BALLAST).unlink(missing_ok=True)


class SecondNode(Stroke):
    """A second process of a node's name."""

    def strike(self) -> None:
        """Starts it."""
        self._system.start_second(self._fault.targets[0])


class WallClock(Stroke):
    """The clock on the wall is set back, for all nodes or for one; the monotonic clock goes on."""

    def strike(self) -> None:
        """Sets it."""
        self._system.set_wall_clock(self._fault.on, -self._fault.amount)


class Again(Stroke):
    """A node is killed again and again, once it is back; the first kill is the fault's signal."""

    def __init__(self, system: System, fault: Fault) -> None:
        super().__init__(system, fault)
        self._killed = self._running(fault.on)
        self._over = threading.Event()
        # Ends with end(), or with the last kill.
        self._thread = threading.Thread(target=self._kill_again, name="kills again", daemon=True)

    def strike(self) -> None:
        """Begins."""
        self._thread.start()

    def end(self) -> None:
        """Lets the node live."""
        self._over.set()

    def _kill_again(self) -> None:
        for _ in range(int(self._fault.amount) - 1):
            pid = self._system.pid(self._fault.on)
            while pid is None or pid == self._killed or not processes.listening_ports(pid):
                if self._over.wait(LOOK):
                    return
                pid = self._system.pid(self._fault.on)
            if self._over.wait(self._fault.delay):
                return
            processes.send(pid, signal.SIGKILL)
            self._killed = pid
            self._system.log.add(Event(time.monotonic(), events.AGAIN, {"node": self._fault.on}))

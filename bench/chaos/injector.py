"""Does a fault, and takes it back when it is over."""

import signal
import threading
import time
from typing import Dict, List, Optional

from chaos.faults import (
    CLIENT,
    CLOCK_BACK,
    DISK_FULL,
    LINK,
    MASTER,
    SECOND_CLOCK,
    SECOND_NODE,
    SIGNAL,
    Fault,
)
from chaos.judging import events
from chaos.judging.events import Event
from chaos.under_test import processes
from chaos.under_test.system import System

SIGNALS = {"KILL": signal.SIGKILL, "STOP": signal.SIGSTOP, "TERM": signal.SIGTERM}
#: The file that fills the disk.
BALLAST = "ballast"
CHUNK = b"\0" * 4096
#: Facts that the client writes to the knowledge base while its disk is full, until one is refused.
WRITTEN_FACTS = tuple(f"(noted f{number})" for number in range(20))


class NotRunning(Exception):
    """A node that has to run does not."""


class Injector:
    """One fault on one system.

    :param fault: what to do; its targets are looked up now, so that the fault itself takes no time.
    :param alone: nodes that die do not come back by themselves.
    :raises NotRunning: when a target does not run.
    :raises LookupError: when the system has none of them.
    """

    def __init__(self, system: System, fault: Fault, alone: bool = False) -> None:
        self._system = system
        self._fault = fault
        self._pids: Dict[str, int] = {}
        self._respawners: Dict[str, int] = {}
        self._timer: Optional[threading.Timer] = None
        self._over = threading.Event()
        if fault.kind == SIGNAL:
            for target in fault.targets:
                pid = system.pid(target)
                if pid is not None:
                    self._pids[target] = pid
                elif target in system.nodes or target in (MASTER, CLIENT):
                    raise NotRunning(f"{target} does not run")
            if not self._pids:
                raise LookupError(f"this system has no {' and no '.join(fault.targets)}")
        if alone:
            found = {target: processes.respawner(pid) for target, pid in self._pids.items()}
            self._respawners = {target: pid for target, pid in found.items() if pid is not None}

    @property
    def over(self) -> bool:
        """Whether a fault that ends by itself has ended."""
        return self._over.is_set()

    def strike(self) -> float:
        """Does the fault and returns when, on the monotonic clock."""
        fault = self._fault
        for respawner in self._respawners.values():
            processes.send(respawner, signal.SIGSTOP)
        at = time.monotonic()
        if fault.kind == SIGNAL:
            for pid in self._pids.values():
                processes.send(pid, SIGNALS[fault.signal])
        elif fault.kind == LINK:
            self._system.network.shape(fault.loss, fault.delay)
        elif fault.kind == CLOCK_BACK:
            self._system.tell_client(do="clock_back")
        elif fault.kind == SECOND_CLOCK:
            self._system.tell_client(do="second_clock")
        elif fault.kind == DISK_FULL:
            self._fill()
            self._system.tell_client(do="write", facts=list(WRITTEN_FACTS))
        elif fault.kind == SECOND_NODE:
            self._system.start_second(fault.targets[0])
        self._system.log.add(Event(at, events.FAULT, {"fault": fault.name, "targets": list(fault.targets)}))
        if fault.lasts is not None:
            # Ends with the fault, or by end().
            self._timer = threading.Timer(fault.lasts, self._end_by_itself)
            self._timer.daemon = True
            self._timer.start()
        return at

    def help(self) -> List[str]:
        """Repairs what does not come back by itself, as an operator would; returns what."""
        fault, system = self._fault, self._system
        helped: List[str] = []
        if fault.kind == LINK and fault.lasts is None:
            system.network.shape()
            helped.append("link healed")
        if fault.kind == SIGNAL:
            helped += self._help_processes()
        if helped:
            self._report(events.HELPED, what=", ".join(helped))
        return helped

    def end(self) -> None:
        """Takes back what is still there; nothing of a fault outlives its trial."""
        if self._timer is not None:
            self._timer.cancel()
        if self._fault.lasts is not None and not self.over:
            self._end_by_itself()
        self._let_respawn()

    def _help_processes(self) -> List[str]:
        fault, system = self._fault, self._system
        helped = []
        if fault.signal == "STOP" and fault.lasts is None:
            for target, pid in self._pids.items():
                if target not in (MASTER, CLIENT):
                    processes.send(pid, signal.SIGKILL)
                    helped.append(f"{target} killed")
        for target in self._pids:
            if target == MASTER and (fault.lasts is None):
                system.start_master_again()
                helped.append("master started again")
            elif target == CLIENT and fault.lasts is None:
                system.start_client()  # the next client is another one; that is not help
            elif target in self._respawners and fault.lasts is None:
                helped.append(f"{target} started again")
        self._let_respawn()
        return helped

    def _let_respawn(self) -> None:
        for respawner in self._respawners.values():
            processes.send(respawner, signal.SIGCONT)

    def _end_by_itself(self) -> None:
        if self._fault.kind == SIGNAL:
            for pid in self._pids.values():
                processes.send(pid, signal.SIGCONT)
        elif self._fault.kind == LINK:
            self._system.network.shape()
        elif self._fault.kind == DISK_FULL:
            (self._system.disk / BALLAST).unlink(missing_ok=True)
        self._report(events.OVER)
        self._over.set()

    def _fill(self) -> None:
        with (self._system.disk / BALLAST).open("wb", buffering=0) as ballast:
            try:
                while True:
                    ballast.write(CHUNK)
            except OSError:
                return  # it is full

    def _report(self, kind: str, **data: object) -> None:
        self._system.log.add(Event(time.monotonic(), kind, data))

# SPDX-License-Identifier: Apache-2.0
"""Does a fault, and takes it back when it is over."""

import signal
import threading
import time
from typing import Dict, List, Optional

from chaos.faults import CLIENT, MASTER, Fault
from chaos.judging import events
from chaos.judging.events import Event
from chaos.striking.kinds import STROKES
from chaos.striking.stroke import NotRunning, Stroke
from chaos.under_test import processes
from chaos.under_test.system import System
from merlin_test.process_signals import wait_stopped

SIGNALS = {"KILL": signal.SIGKILL, "STOP": signal.SIGSTOP, "TERM": signal.SIGTERM}


class Injector:
    """One fault on one system: the stroke of its kind, and signals to its targets.

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
        if fault.signal:
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
        self._stroke = STROKES.get(fault.kind, Stroke)(system, fault)

    @property
    def over(self) -> bool:
        """Whether a fault that ends by itself has ended."""
        return self._over.is_set()

    def strike(self) -> float:
        """Does the fault and returns when, on the monotonic clock."""
        fault = self._fault
        for respawner in self._respawners.values():
            processes.send(respawner, signal.SIGSTOP)
            wait_stopped(respawner)
        at = time.monotonic()
        self._stroke.strike()
        for pid in self._pids.values():
            processes.send(pid, SIGNALS[fault.signal])
        if fault.signal == "STOP":
            for pid in self._pids.values():
                wait_stopped(pid)
        self._system.log.add(Event(at, events.FAULT, {"fault": fault.name, "targets": list(fault.targets)}))
        if fault.lasts is not None:
            # Ends with the fault, or by end().
            self._timer = threading.Timer(fault.lasts, self._end_by_itself)
            self._timer.daemon = True
            self._timer.start()
        return at

    def help(self) -> List[str]:
        """Repairs what does not come back by itself, as an operator would; returns what."""
        helped = self._stroke.help() if self._fault.lasts is None else []
        if self._fault.signal:
            helped += self._help_processes()
        if helped:
            self._report(events.HELPED, what=", ".join(helped))
        return helped

    def end(self) -> None:
        """Takes back what is still there; nothing of a fault outlives its trial."""
        if self._timer is not None:
            self._timer.cancel()
        if self._fault.lasts is None:
            self._stroke.end()
        elif not self.over:
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
        if self._fault.signal == "STOP":
            for pid in self._pids.values():
                processes.send(pid, signal.SIGCONT)
        self._stroke.end()
        self._report(events.OVER)
        self._over.set()

    def _report(self, kind: str, **data: object) -> None:
        self._system.log.add(Event(time.monotonic(), kind, data))

# SPDX-License-Identifier: Apache-2.0
"""How long the system under test had to wait for the machine, and not for its own mistakes.

A starved machine makes every figure of a trial worse. The kernel counts for each thread how long it was ready
and had no processor; sampled over all threads of the system, that is an upper bound of what the machine, and
not the robot, has added to a figure.
"""

import os
import threading
import time
from pathlib import Path
from typing import Callable, Dict, Set, Tuple

from chaos.judging import events
from chaos.judging.events import Event
from chaos.under_test import processes

#: s between two samples.
PERIOD = 0.25
#: Field of /proc/stat's first line: time that a hypervisor gave to others.
STOLEN = 8

Delays = Dict[Tuple[int, str], int]


class Waiting:
    """What the threads of a run have waited for a processor.

    :param run: mark of the processes.
    """

    def __init__(self, run: str, proc: Path = Path("/proc")) -> None:
        self._run = run
        self._proc = proc
        self._ours: Set[int] = set()
        self._seen: Set[int] = set()
        self._sure: Set[int] = set()
        self._delays: Delays = {}
        self._stolen = self._stolen_so_far()
        self.since_last()

    def since_last(self) -> float:
        """s that all threads together have waited since the last call, or since they began."""
        delays, stolen = self._delays_so_far(), self._stolen_so_far()
        waited = sum(delay - self._delays.get(thread, 0) for thread, delay in delays.items()) / 1e9
        waited += stolen - self._stolen
        self._delays, self._stolen = delays, stolen
        return waited

    def _delays_so_far(self) -> Delays:
        """ns that each thread has waited in its life."""
        found: Delays = {}
        for pid in self._pids():
            folder = f"{self._proc}/{pid}/task"
            try:
                threads = os.listdir(folder)
            except OSError:
                continue  # it has ended
            for thread in threads:
                try:
                    with open(f"{folder}/{thread}/schedstat", "rb") as file:
                        found[pid, thread] = int(file.read().split()[1])
                except (OSError, IndexError, ValueError):
                    continue
        return found

    def _pids(self) -> Set[int]:
        """Processes of the run. A new one is looked at twice: the first time it may not have begun its own
        program, and with it its environment."""
        now = set(processes.ids(self._proc))
        unsure = now - self._sure
        self._ours &= now
        self._ours |= {pid for pid in unsure if processes.is_marked(self._run, pid, self._proc)}
        self._sure, self._seen = now & self._seen, now
        return self._ours

    def _stolen_so_far(self) -> float:
        try:
            fields = (self._proc / "stat").read_text().splitlines()[0].split()
            return int(fields[STOLEN]) / float(os.sysconf("SC_CLK_TCK"))
        except (OSError, IndexError, ValueError):
            return 0.0


class Pressure:
    """Samples a system and reports an event per period.

    :param run: mark of the system's processes.
    :param report: takes the events.
    """

    def __init__(self, run: str, report: Callable[[Event], None]) -> None:
        self._waiting = Waiting(run)
        self._report = report
        self._over = threading.Event()
        # Ends with close().
        self._thread = threading.Thread(target=self._sample, name="pressure", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Ends the sampling."""
        self._over.set()
        self._thread.join()

    def _sample(self) -> None:
        at = time.monotonic()
        while not self._over.wait(PERIOD):
            waited, now = self._waiting.since_last(), time.monotonic()
            span = now - at
            self._report(Event(now, events.WAITED, {"span": span, "waited": min(span, waited)}))
            at = now

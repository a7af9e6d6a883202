# SPDX-License-Identifier: Apache-2.0
"""What dies again and again does so as often as the fault says, each time when it is back."""

import subprocess
import sys
import threading
import time
from typing import List, Optional

from chaos.faults import AGAIN, Fault
from chaos.judging import events
from chaos.judging.events import Event, EventLog
from chaos.striking.surroundings import Again

from merlin_test import LONG

SERVER = """
import socket, sys
server = socket.create_server(("127.0.0.1", 0))
sys.stdin.read()
"""


class Respawning:
    """A system with one node that is started again whenever it has died."""

    def __init__(self) -> None:
        self.log = EventLog()
        self.lives: List[subprocess.Popen[bytes]] = []
        self._changed = threading.Lock()  # guards lives
        self.start()

    def start(self) -> None:
        with self._changed:
            command = [sys.executable, "-c", SERVER]
            self.lives.append(subprocess.Popen(command, stdin=subprocess.PIPE))

    def pid(self, node: str) -> Optional[int]:
        with self._changed:
            life = self.lives[-1]
        return life.pid if node == "node" and life.poll() is None else None

    def kill_all(self) -> None:
        for life in self.lives:
            life.kill()
            life.communicate()


def test_a_node_is_killed_as_often_as_the_fault_says() -> None:
    system = Respawning()
    try:
        fault = Fault("again:node", AGAIN, ("node",), "KILL", 100.0, delay=0.01, on="node", amount=3)
        stroke = Again(system, fault)  # type: ignore[arg-type]
        stroke.strike()
        for _ in range(3):
            # The first kill is the injector's; the others are the stroke's.
            if len(system.lives) == 1:
                system.lives[0].kill()
            assert system.lives[-1].wait(LONG) == -9
            system.start()
        reported: List[str] = []

        def second(event: Event) -> Optional[bool]:
            reported.append(event.kind)
            return True if len(reported) == 2 else None

        assert system.log.wait_for(0, second, time.monotonic() + LONG, time.monotonic)
        assert reported == [events.AGAIN] * 2
        stroke.end()
        assert system.pid("node") is not None
    finally:
        system.kill_all()

# SPDX-License-Identifier: Apache-2.0
"""One run of a state in a thread of its own."""

import threading
from typing import Callable, Optional

from merlin_ros.work.threads import failure_logged, start_thread
from merlin_sm.autonomy import label_text
from merlin_sm.merlin_sm import MerlinSM


class StateRun:
    """Runs a machine once.

    :param machine: the state machine; no other run of it is under way.
    :param on_end: called with this run, in its thread, when it has ended.
    :ivar outcome: of the machine, once it has ended.
    :ivar error: what the machine has raised instead.
    """

    def __init__(self, machine: MerlinSM, on_end: Callable[["StateRun"], None] = lambda run: None) -> None:
        self.machine = machine
        self.outcome: Optional[str] = None
        self.error: Optional[BaseException] = None
        self.ended = threading.Event()
        self._on_end = on_end
        self._lock = threading.Lock()  # guards the field below
        self.interrupted = False
        """Whether its stop was requested."""
        machine.prepare()

    def start(self, after: Callable[[], None]) -> None:
        """Begins, in a thread of its own.

        :param after: called last in that thread.
        """

        def run() -> None:
            self.run()
            after()

        label = ", ".join(map(label_text, self.machine.get_children()))
        try:
            start_thread(f"behaviour {label}", run)
        except RuntimeError as error:  # no further thread: the tree, which waits for its end, raises it
            self._end(error)
            after()

    def run(self) -> None:
        """Runs it in this thread."""
        try:
            self.outcome = self.machine.execute()
        except BaseException as error:  # users' code may raise anything; the tree raises it in its own thread
            self._end(error)
        else:
            self._end(None)

    def _end(self, error: Optional[BaseException]) -> None:
        self.error = error
        self.ended.set()
        self._on_end(self)

    def interrupt(self) -> None:
        """Preempts it, once; its end is reported as any other."""
        with self._lock:
            if self.interrupted:
                return
            self.interrupted = True
        # Users' code; what else runs in the tree still has to be interrupted.
        with failure_logged("the preempt of a behaviour", BaseException):
            self.machine.cancel()

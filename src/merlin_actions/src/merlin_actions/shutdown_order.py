# SPDX-License-Identifier: Apache-2.0
"""What runs actions, and the end of a node with several: it stops all of them before it waits for one."""

import threading
from abc import ABC, abstractmethod
from typing import Any, Callable, List, Sequence

from merlin_ros.alarms import wait_ticks
from merlin_ros.work.threads import failure_logged
from merlin_ros.work.work_book import Decision, WorkBook

MASTER_LOST = "the ROS master is lost"
GOES_ON = "a node that ends continues with its end"

#: Wall seconds in which all that runs can stop the robot when its node ends.
SHUTDOWN_WAIT = 2.0


class Serving(ABC):
    """What runs actions, as a book decides, which is guarded by `_changed`."""

    _changed: threading.Condition
    _book: WorkBook[Any]

    @abstractmethod
    def stop(self) -> None:
        """Stops what runs, and begins nothing more; does not wait."""

    @abstractmethod
    def wait_stopped(self, seconds: float) -> bool:
        """Waits until what ran has stopped and is answered; returns whether it is.

        :param seconds: of wall time at most.
        """

    @abstractmethod
    def close(self) -> None:
        """Stops serving; comes last."""

    @abstractmethod
    def _carry_out(self, decisions: List[Decision]) -> None:
        """Carries out the book's decisions; without the lock."""

    def _decide(self, event: Callable[[WorkBook[Any]], List[Decision]]) -> None:
        """Puts an event into the book, and carries out what that decides."""
        with self._changed:
            decisions = event(self._book)
        self._carry_out(decisions)

    def shutdown(self) -> None:
        """Stops what runs, waits until it has ended, and stops serving; of several see :func:`shut_down`."""
        shut_down([self])

    def master_lost(self) -> None:
        """Stops what runs: nothing else of the system can be found any more."""
        self._decide(lambda book: book.cancel_all(MASTER_LOST))


def shut_down(parts: Sequence[Serving]) -> None:
    """Ends them all; waits at most ``SHUTDOWN_WAIT`` for what they run.

    What one of them raises is logged: the others have to stop, too.
    """
    for part in parts:
        with failure_logged(GOES_ON):
            part.stop()
    wait_ticks(lambda tick: all(part.wait_stopped(tick) for part in parts), SHUTDOWN_WAIT)
    for part in parts:
        with failure_logged(GOES_ON):
            part.close()

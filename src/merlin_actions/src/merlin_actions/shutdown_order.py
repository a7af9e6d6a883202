# SPDX-License-Identifier: Apache-2.0
"""The end of a node that runs several actions: it stops all of them before it waits for one."""

from typing import Callable, Protocol, Sequence

from merlin_ros.alarms import wait_ticks
from merlin_ros.work.threads import log_failure

#: Wall seconds in which all that runs can stop the robot when its node ends.
SHUTDOWN_WAIT = 2.0


class Serving(Protocol):
    """What runs actions."""

    def stop(self) -> None:
        """Stops what runs, and begins nothing more; does not wait."""

    def wait_stopped(self, seconds: float) -> bool:
        """Waits until what ran has stopped and is answered; returns whether it is.

        :param seconds: of wall time at most.
        """

    def close(self) -> None:
        """Stops serving; comes last."""


def shut_down(parts: Sequence[Serving]) -> None:
    """Ends them all; waits at most ``SHUTDOWN_WAIT`` for what they run.

    What one of them raises is logged: the others have to stop, too.
    """
    for part in parts:
        _try(part.stop)
    wait_ticks(lambda tick: all(part.wait_stopped(tick) for part in parts), SHUTDOWN_WAIT)
    for part in parts:
        _try(part.close)


def _try(call: Callable[[], None]) -> None:
    try:
        call()
    except Exception:
        log_failure("a node that ends continues with its end")

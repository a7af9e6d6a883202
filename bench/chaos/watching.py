# SPDX-License-Identifier: Apache-2.0
"""Waits of a trial: for events of its log, and for what the witness is asked to do; each with an end."""

import time
from typing import Callable, Optional

from chaos.faults import NODES
from chaos.judging import events
from chaos.judging.events import Event
from chaos.judging.evidence import REQUEST
from chaos.judging.scene import Scene
from chaos.moments import Moment, holds
from chaos.under_test.system import System

#: s for a stop to be driven and released, asking included: longer than the witness takes at most.
STOP_WATCH = 20.0


class Watching:
    """Waits for what the witness and the client report.

    :param system: whose log it is.
    """

    def __init__(self, system: System) -> None:
        self._system = system
        self._log = system.log
        self._begin = self._log.position()

    def _ended(self, label: str, limit: float) -> bool:
        found = self._log.wait_for(
            self._begin,
            lambda event: True if event.kind == events.ENDED and event["label"] == label else None,
            time.monotonic() + limit,
            time.monotonic,
        )
        return bool(found)

    def _ended_or_drives(self, goes_on: float, limit: float) -> bool:
        """Whether the request has ended; False at once when the base drives after a time.

        :param goes_on: from when on, s on the monotonic clock.
        :param limit: s to wait at most.
        """
        scene = Scene()

        def find(event: Event) -> Optional[bool]:
            scene.apply(event)
            if event.kind == events.ENDED and event["label"] == REQUEST:
                return True
            drives = event.at >= goes_on and holds(Moment.DRIVING, scene)
            return False if drives else None

        found = self._log.wait_for(self._begin, find, time.monotonic() + limit, time.monotonic)
        return bool(found)

    def _find(self, kind: str, limit: float) -> Optional[Event]:
        return self._log.wait_for(
            self._begin,
            lambda event: event if event.kind in (kind, "failed") else None,
            time.monotonic() + limit,
            time.monotonic,
        )

    def _until(self, kind: str, begin: float, limit: float, holds_: Callable[[Event], bool]) -> bool:
        found = self._log.wait_for(
            self._begin,
            lambda event: True if event.kind == kind and event.at >= begin and holds_(event) else None,
            time.monotonic() + limit,
            time.monotonic,
        )
        return bool(found)

    def _pause(self, seconds: float) -> None:
        """Lets time go by, in which the witness watches."""
        self._log.wait_for(
            self._log.position(), lambda event: None, time.monotonic() + seconds, time.monotonic
        )

    def _report(self, kind: str, **data: object) -> None:
        self._log.add(Event(time.monotonic(), kind, data))

    def _drive_stop(self) -> None:
        """The witness stops the base as a button does, and releases it."""
        self._system.tell_witness(do="stop", service="merlin/stop", release="merlin/release")
        if self._find(events.RELEASED, STOP_WATCH) is None:
            self._report(events.RELEASED, error="the witness does not say that it is")

    def _probe_nodes(self, limit: float) -> None:
        """The witness asks each node at its ports, until it answers.

        :param limit: s in which a node has been started again.
        """
        position = self._log.position()
        left = {node for node in self._system.nodes if node in NODES}
        self._system.tell_witness(do="probe", nodes=sorted(left), limit=limit)

        def find(event: Event) -> Optional[bool]:
            if event.kind == events.PROBED:
                left.discard(event["node"])
            return None if left else True

        self._log.wait_for(position, find, time.monotonic() + limit + STOP_WATCH, time.monotonic)

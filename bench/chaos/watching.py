"""Waits of a trial: for events of its log, each with an end."""

import time
from typing import Callable, Optional

from chaos.judging import events
from chaos.judging.events import Event, EventLog
from chaos.judging.evidence import REQUEST
from chaos.judging.scene import Scene
from chaos.moments import Moment, holds


class Watching:
    """Waits for what the witness and the client report.

    :param log: of the system.
    """

    def __init__(self, log: EventLog) -> None:
        self._log = log
        self._begin = log.position()

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

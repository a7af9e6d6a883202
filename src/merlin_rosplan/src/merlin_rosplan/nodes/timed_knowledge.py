"""Applies timed knowledge on time."""

import threading
import time
from typing import Optional

import rospy
from rospy.rostime import get_rostime_cond, is_wallclock

from merlin_pddl.text_reader import shortened
from merlin_rosplan.knowledge.knowledge_store import JournalError, KnowledgeStore
from merlin_rosplan.knowledge.transaction import StateChange

RETRY = 1.0  # s of wall time before a state file that could not be written is tried again


class TimedKnowledge:
    """Watches a store's timed items in ROS time. Its thread sleeps until the next one, or until that changes.

    :param store: holds the items.
    :param client: the name that is reported as the author of the changes.
    """

    def __init__(self, store: KnowledgeStore, client: str) -> None:
        self._store = store
        self._client = client
        # rospy wakes all waiters on this condition when /clock moves; it guards the two flags below
        self._time = get_rostime_cond()
        self._ended = False
        self._changed = False
        self._due: Optional[int] = None
        store.listen(self._wake)
        self._thread = threading.Thread(target=self._run, name=f"{client} timed knowledge", daemon=True)
        self._thread.start()

    def _wake(self, _change: StateChange) -> None:
        if self._store.next_due() != self._due:
            with self._time:
                self._changed = True
                self._time.notify_all()

    def shutdown(self) -> None:
        """Ends the thread."""
        with self._time:
            self._ended = True
            self._time.notify_all()
        self._thread.join()

    def _run(self) -> None:
        while not self._ended:
            with self._time:
                self._changed = False
            try:
                for reason in self._store.fire_due(self._client):
                    rospy.logwarn("%s: %s", self._client, shortened(reason))
            except JournalError as error:
                rospy.logerr_throttle(60.0, f"{self._client}: what is due has to wait: {error}")
                self._pause(RETRY)
                continue
            # asked outside of the condition, which rospy's clock thread must get at any time
            self._due = due = self._store.next_due()
            with self._time:
                while not self._ended and not self._changed:
                    remaining = None if due is None else (due - rospy.get_rostime().to_nsec()) / 1e9
                    if remaining is not None and remaining <= 0:
                        break
                    # a simulated clock may be slower or faster, or jump: it wakes us at every step
                    self._time.wait(remaining if remaining is not None and is_wallclock() else None)

    def _pause(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        with self._time:
            while not self._ended and time.monotonic() < end:
                self._time.wait(end - time.monotonic())

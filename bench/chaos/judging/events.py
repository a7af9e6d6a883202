# SPDX-License-Identifier: Apache-2.0
"""What happened in a trial, in the order of time: events, and the log that collects them.

Every process of the campaign stamps its events with the machine's monotonic clock, which is the same for all
of them, so a log of several witnesses can be put in order.
"""

import threading
from dataclasses import dataclass, field
from typing import Any, Callable, Dict, List, Optional, TypeVar

#: Ground truth of the base: speed (m/s), turn (rad/s), x, y (m, frame map).
TRUTH = "truth"
#: A velocity command that reached the base: speed, turn.
COMMAND = "command"
#: An action server's active goals changed: server, active (ids), ended ({id: status}).
GOALS = "goals"
#: The Executor's status changed: state, stage, request.
STATUS = "status"
#: Something was put on action_dispatch: name, action, plan.
DISPATCH = "dispatch"
#: Something was put on action_feedback: action, plan, status, information.
FEEDBACK = "feedback"
#: The guard's state changed: state, reason, moving.
GUARD = "guard"
#: The client sent a request: label, goals, deadline (s from then; None: it has none).
SENT = "sent"
#: The client cancelled a request: label.
CANCEL = "cancel"
#: The client got the end of a request: label, outcome, reason, action, state.
ENDED = "ended"
#: The fault was done: fault, targets.
FAULT = "fault"
#: A node that had come back was killed again: node.
AGAIN = "again"
#: The fault is over by itself (the process continues, the link is back).
OVER = "over"
#: The campaign repaired what does not come back by itself: what.
HELPED = "helped"
#: What the knowledge base answered: robot_at (list), notes (list), goals (list), where wanted said (list); or
#: error.
FACTS = "facts"
#: A process of the campaign has ended: child.
GONE = "gone"
#: Processes that a planner has left behind were counted: count.
LEFT = "left"
#: How the machine served the system: span (s until now), waited (s of it for which the system had to wait for
#: a processor, at most).
WAITED = "waited"
#: A node said something on rosout, a warning or worse: node, level, text.
SAID = "said"
#: The client has put a fact into the knowledge base during the fault: fact, error (empty: acknowledged).
WRITTEN = "written"
#: Nodes that were not back at the trial's end were counted: nodes (list).
MISSING = "missing"
#: The witness asked `merlin/stop`: asked (s, when), ticks (s by its own looks), error (empty: answered).
STOPPED = "stopped"
#: The base was released after that: error (empty: it was).
RELEASED = "released"
#: The robot was asked why the request failed: sentence, error (empty: it was answered).
WHY = "why"
#: A node was asked at its ports: node, error (empty: it answers).
PROBED = "probed"
#: The page has answered an operator: what, status, words, asked (s, when).
PAGE = "page"
#: From here on the next goal may be sent.
NEXT = "next"
#: The trial's judged time ends here.
CLOSED = "closed"

Found = TypeVar("Found")


@dataclass(frozen=True)
class Event:
    """Something that happened.

    :param at: s, monotonic clock of the machine.
    :param kind: one of the constants of this module.
    :param data: what the kind says.
    """

    at: float
    kind: str
    data: Dict[str, Any] = field(default_factory=dict)

    def __getitem__(self, key: str) -> Any:
        return self.data[key]

    def get(self, key: str, default: Any = None) -> Any:
        """A value of the event."""
        return self.data.get(key, default)


class EventLog:
    """Collects events from several threads and lets one wait for them."""

    def __init__(self) -> None:
        self._changed = threading.Condition()  # guards _events and _closed
        self._events: List[Event] = []
        self._closed = ""

    def add(self, event: Event) -> None:
        """Appends an event."""
        with self._changed:
            self._events.append(event)
            self._changed.notify_all()

    def close(self, reason: str) -> None:
        """Ends every wait, now and later, with :class:`LogClosed`."""
        with self._changed:
            self._closed = self._closed or reason
            self._changed.notify_all()

    def position(self) -> int:
        """How many events there are; :meth:`wait_for` and :meth:`since` continue from there."""
        with self._changed:
            return len(self._events)

    def since(self, position: int) -> List[Event]:
        """The events from a position on, in the order of time."""
        with self._changed:
            return sorted(self._events[position:], key=lambda event: event.at)

    def wait_for(
        self, position: int, find: Callable[[Event], Optional[Found]], end: float, clock: Callable[[], float]
    ) -> Optional[Found]:
        """Waits for an event from a position on.

        :param find: called once with each event; what it returns, unless None, ends the wait.
        :param end: of the wait, s of the clock.
        :return: what `find` returned; None when the time is over.
        :raises LogClosed: when the log was closed meanwhile.
        """
        with self._changed:
            while True:
                while position < len(self._events):
                    found = find(self._events[position])
                    position += 1
                    if found is not None:
                        return found
                if self._closed:
                    raise LogClosed(self._closed)
                left = end - clock()
                if left <= 0.0:
                    return None
                self._changed.wait(left)


class LogClosed(Exception):
    """The trial was broken off; the text says why."""

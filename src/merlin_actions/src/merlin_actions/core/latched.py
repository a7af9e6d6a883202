# SPDX-License-Identifier: Apache-2.0
"""Which dispatches may be older than an action interface. Without ROS."""

from typing import Any, Dict, FrozenSet, Iterable, List, Mapping, Optional, Tuple

LATCH_GRACE = 0.3  # s after connecting to a dispatcher in which its latched, perhaps old, message arrives
KEEP_CONNECTIONS = 8  # of earlier processes of the dispatcher


class Latched:
    """Separates dispatches latched before an interface began from new ones. Not thread-safe.

    What may be old is put aside until its dispatcher says that it waits for it.

    :ivar connected: when the dispatcher's connection was opened, s of running time; None: not yet.
    """

    def __init__(self) -> None:
        self.connected: Optional[float] = None
        self._headers: List[Mapping[str, str]] = []  # of the connections that a message came over
        self._aside: Dict[Tuple[int, int], Any] = {}
        self._awaited: Optional[FrozenSet[Tuple[int, int]]] = None  # None: the dispatcher does not say

    def may_be_old(self, message: Any, now: float) -> bool:
        """Whether a message may be an old one; to be asked of each, in their order.

        On a busy machine a latched message comes long after the connection. Of a dispatcher that says for
        which actions it waits, the first message of a connection is always a latched one.

        :param now: s of running time.
        """
        header = getattr(message, "_connection_header", None) or {}
        first = not any(header is known for known in self._headers)  # rospy keeps one for each connection
        if first:
            self._headers = [*self._headers[-KEEP_CONNECTIONS:], header]
        just_connected = self.connected is None or now - self.connected < LATCH_GRACE
        return header.get("latching") == "1" and (just_connected or (first and self._awaited is not None))

    def begins(self, dispatch: Any, old: bool) -> bool:
        """Whether an action begins now; what is of other plans is dropped then. Else it is put aside.

        :param old: as of :meth:`may_be_old`; an old one must not run again, unless it is waited for.
        """
        key = _key(dispatch)
        if old and key not in (self._awaited or ()):
            self._aside[key] = dispatch
            return False
        self._aside = {other: kept for other, kept in self._aside.items() if other[0] == key[0]}
        return True

    def drop(self, dispatch: Any) -> None:
        """Its action is cancelled."""
        self._aside.pop(_key(dispatch), None)

    def take(self, awaited: Iterable[Tuple[int, int]]) -> List[Any]:
        """Takes those that were put aside and that the dispatcher waits for.

        :param awaited: plan id and action id of each.
        """
        self._awaited = frozenset(awaited)
        found = [key for key in self._aside if key in self._awaited]
        return [self._aside.pop(key) for key in found]


def _key(dispatch: Any) -> Tuple[int, int]:
    return dispatch.plan_id, dispatch.action_id

# SPDX-License-Identifier: Apache-2.0
"""Which dispatches may be older than an action interface, and those put aside for it. Without ROS."""

from typing import Any, Dict, FrozenSet, Iterable, List, Mapping, Optional, Tuple

LATCH_GRACE = 0.3  # s after connecting to a dispatcher in which its latched, perhaps old, message arrives
KEEP_CONNECTIONS = 8  # of earlier processes of the dispatcher


class Latched:
    """Separates messages latched before an interface began from new ones. Not thread-safe.

    :ivar connected: when the dispatcher's connection was opened, s of running time; None: not yet.
    :ivar names_waiting: whether the dispatcher says for which actions it waits.
    """

    def __init__(self) -> None:
        self.connected: Optional[float] = None
        self.names_waiting = False
        self._headers: List[Mapping[str, str]] = []  # of the connections that a message came over

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
        return header.get("latching") == "1" and (just_connected or (first and self.names_waiting))


class PutAside:
    """Dispatches that may be old, until their dispatcher says that it waits for them. Not thread-safe."""

    def __init__(self) -> None:
        self._dispatches: Dict[Tuple[int, int], Any] = {}
        self._awaited: FrozenSet[Tuple[int, int]] = frozenset()

    def put(self, dispatch: Any) -> None:
        """Keeps a dispatch; one of the same ids is replaced."""
        self._dispatches[_key(dispatch)] = dispatch

    def drop(self, dispatch: Any) -> None:
        """Its action is cancelled."""
        self._dispatches.pop(_key(dispatch), None)

    def keep(self, plan_id: int) -> None:
        """Drops what is of other plans."""
        self._dispatches = {key: kept for key, kept in self._dispatches.items() if key[0] == plan_id}

    def awaited(self, dispatch: Any) -> bool:
        """Whether the dispatcher has said last that it waits for this action."""
        return _key(dispatch) in self._awaited

    def take(self, awaited: Iterable[Tuple[int, int]]) -> List[Any]:
        """Takes those that the dispatcher waits for.

        :param awaited: plan id and action id of each.
        """
        self._awaited = frozenset(awaited)
        found = [key for key in self._dispatches if key in self._awaited]
        return [self._dispatches.pop(key) for key in found]


def _key(dispatch: Any) -> Tuple[int, int]:
    return dispatch.plan_id, dispatch.action_id

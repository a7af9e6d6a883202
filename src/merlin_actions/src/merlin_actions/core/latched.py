"""Which dispatches may be older than an action interface. Without ROS."""

from typing import Any, List, Mapping, Optional

LATCH_GRACE = 0.3  # s after connecting to a dispatcher in which its latched, perhaps old, message arrives
KEEP_CONNECTIONS = 8  # of former lives of the dispatcher


class Latched:
    """Tells what was latched before an interface began from what is new. Not thread-safe.

    :ivar connected: when the dispatcher's connection was opened, s of running time; None: not yet.
    :ivar told: whether the dispatcher says for which actions it waits.
    """

    def __init__(self) -> None:
        self.connected: Optional[float] = None
        self.told = False
        self._headers: List[Mapping[str, str]] = []  # of the connections that a message came over

    def may_be_old(self, message: Any, now: float) -> bool:
        """Whether a message may be an old one; to be asked of each, in their order.

        On a busy machine a latched message comes long after the connection. Of a dispatcher that tells for
        which actions it waits, the first message of a connection is always a latched one.

        :param now: s of running time.
        """
        header = getattr(message, "_connection_header", None) or {}
        first = not any(header is known for known in self._headers)  # rospy keeps one for each connection
        if first:
            self._headers = [*self._headers[-KEEP_CONNECTIONS:], header]
        young = self.connected is None or now - self.connected < LATCH_GRACE
        return header.get("latching") == "1" and (young or (first and self.told))

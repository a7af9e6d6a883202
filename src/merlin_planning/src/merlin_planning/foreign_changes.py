# SPDX-License-Identifier: Apache-2.0
"""What is changed in a knowledge base: a client that keeps facts there writes them again."""

from typing import Any, Callable, Optional, Set

import rospy
from merlin_msgs.msg import KnowledgeChanges

from merlin_ros.actions.peers import open_sockets
from merlin_ros.alarms import TICK, every


class ForeignChanges:
    """Follows ``<kb>/changes`` of a knowledge base of ours.

    :param knowledge_base: its global name.
    :param changed: called with each change that another node has made; None: everything may have changed, as
        the knowledge base was cleared or has begun anew, or was out of reach. Must not block.
    :param own: those that this node has made count too.
    """

    def __init__(
        self, knowledge_base: str, changed: Callable[[Optional[KnowledgeChanges]], None], own: bool = False
    ) -> None:
        self._changed = changed
        self._ignored = "" if own else rospy.get_name()
        self._sockets: Set[Any] = set()  # of the connections at the last look
        self._subscriber = rospy.Subscriber(
            f"{knowledge_base}/changes", KnowledgeChanges, self._receive, tcp_nodelay=True
        )
        self._looks = every(TICK, self._look)

    @property
    def connected(self) -> bool:
        """Whether the knowledge base publishes its changes."""
        return bool(self._subscriber.get_num_connections())

    def shutdown(self) -> None:
        """Follows them no more."""
        self._looks.cancel()
        self._subscriber.unregister()

    def _receive(self, message: KnowledgeChanges) -> None:
        if message.client != self._ignored or not self._ignored:
            self._changed(None if message.cleared else message)

    def _look(self) -> None:
        """A knowledge base that begins anew publishes nothing of that: a new connection shows it."""
        before, self._sockets = self._sockets, open_sockets(self._subscriber)
        if self._sockets - before:
            self._changed(None)

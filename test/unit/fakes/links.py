# SPDX-License-Identifier: Apache-2.0
"""The subscriber of a topic whose publisher begins anew."""

import socket
from types import SimpleNamespace
from typing import Any, Callable, List


class Link:
    """Takes the place of a rospy.Subscriber."""

    def __init__(self, topic: str, _: type, callback: Callable[[Any], None], **__: Any) -> None:
        self.topic = topic
        self.publish = callback
        self.impl = SimpleNamespace(connections=[])
        self._ends: List[socket.socket] = []

    def begin_anew(self) -> None:
        """Another process publishes from now on."""
        for end in self._ends:
            end.close()
        self._ends = list(socket.socketpair())
        self.impl.connections = [SimpleNamespace(socket=self._ends[0])]

    def get_num_connections(self) -> int:
        return len(self.impl.connections)

    def unregister(self) -> None:
        for end in self._ends:
            end.close()

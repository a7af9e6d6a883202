# SPDX-License-Identifier: Apache-2.0
"""The topics of a process without ROS: messages for what it subscribes, and what it publishes."""

import threading
from collections import defaultdict
from queue import Queue
from types import SimpleNamespace
from typing import Any, Callable, DefaultDict, Dict, List, Optional

import pytest
import rospy


class Topics:
    """Takes the place of rospy's publishers and subscribers. Topics by their global names.

    :ivar before: called with the topic and each message before it is published; may raise.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self._callbacks: DefaultDict[str, List[Callable[[Any], None]]] = defaultdict(list)
        self._listeners: DefaultDict[str, List[Any]] = defaultdict(list)
        self._sent: DefaultDict[str, Queue[Any]] = defaultdict(Queue)
        self._lock = threading.Lock()  # guards the queues' dictionary
        self.before: Callable[[str, Any], None] = lambda topic, message: None
        monkeypatch.setattr(rospy, "Publisher", self._publisher)
        monkeypatch.setattr(rospy, "Subscriber", self._subscriber)

    def send(self, topic: str, message: Any, header: Optional[Dict[str, str]] = None) -> None:
        """Another node publishes a message; returns when it was read.

        :param header: of the connection; default: of a node ``/other``.
        """
        message._connection_header = {"callerid": "/other"} if header is None else header
        for callback in list(self._callbacks[topic]):
            callback(message)

    def subscribe(self, topic: str) -> None:
        """Another node subscribes."""
        for listener in self._listeners[topic]:
            listener.peer_subscribe(topic, None, None)

    def published(self, topic: str) -> "Queue[Any]":
        """What the process has published and no test has taken."""
        with self._lock:
            return self._sent[topic]

    def _publisher(self, name: str, _: type, subscriber_listener: Any = None, **__: Any) -> Any:
        topic = rospy.resolve_name(name)
        if subscriber_listener is not None:
            self._listeners[topic].append(subscriber_listener)

        closed = threading.Event()

        def publish(message: Any) -> None:
            if closed.is_set():
                raise rospy.ROSException("publish() to a closed topic")
            self.before(topic, message)
            self.published(topic).put(message)

        return SimpleNamespace(
            impl=None, publish=publish, unregister=closed.set, get_num_connections=lambda: 1
        )

    def _subscriber(self, name: str, _: type, callback: Callable[[Any], None], **__: Any) -> Any:
        callbacks = self._callbacks[rospy.resolve_name(name)]
        callbacks.append(callback)
        return SimpleNamespace(impl=None, unregister=lambda: callbacks.remove(callback))

"""Handing a message to a component of the same process at once, besides publishing it.

ROSPlan passes problem, plan text and plan along by latched topics: a stage that is called right after the one
before it may still hold the old message. Components that share a process hand over in the call itself; what
then arrives on the topic from this node is dropped.
"""

import threading
from typing import Any, Callable, ClassVar, Dict, List

import rospy

Receiver = Callable[[Any], None]


class Handover:
    """The topics of this process whose receivers are served directly."""

    _lock: ClassVar[threading.Lock] = threading.Lock()  # guards both registers
    _receivers: ClassVar[Dict[str, List[Receiver]]] = {}
    _senders: ClassVar[Dict[str, int]] = {}

    @classmethod
    def sender(cls, topic: str) -> "Sender":
        """Says that messages on this topic (global name) will be handed over by :meth:`Sender.hand_over`."""
        with cls._lock:
            cls._senders[topic] = cls._senders.get(topic, 0) + 1
        return Sender(topic)

    @classmethod
    def receiver(cls, topic: str, receive: Receiver) -> "Subscription":
        """Receives what is handed over; use :meth:`Subscription.from_topic` as the topic's callback."""
        with cls._lock:
            cls._receivers.setdefault(topic, []).append(receive)
        return Subscription(topic, receive)


class Sender:
    """Hands messages of one topic over."""

    def __init__(self, topic: str) -> None:
        self._topic = topic

    def hand_over(self, message: Any) -> None:
        """Gives the message to every receiver of this process, in the calling thread."""
        with Handover._lock:
            receivers = list(Handover._receivers.get(self._topic, ()))
        for receive in receivers:
            receive(message)

    def shutdown(self) -> None:
        """From now on the topic alone carries the messages."""
        with Handover._lock:
            count = Handover._senders.get(self._topic, 0)
            if count > 1:
                Handover._senders[self._topic] = count - 1
            else:
                Handover._senders.pop(self._topic, None)


class Subscription:
    """Receives the messages of one topic, each once."""

    def __init__(self, topic: str, receive: Receiver) -> None:
        self._topic = topic
        self._receive = receive

    def from_topic(self, message: Any) -> None:
        """Callback for a rospy.Subscriber of the topic: drops what was handed over already."""
        caller = message._connection_header.get("callerid")
        with Handover._lock:
            handed_over = caller == rospy.get_name() and self._topic in Handover._senders
        if not handed_over:
            self._receive(message)

    def shutdown(self) -> None:
        """Receives no more."""
        with Handover._lock:
            receivers = Handover._receivers.get(self._topic, [])
            if self._receive in receivers:
                receivers.remove(self._receive)

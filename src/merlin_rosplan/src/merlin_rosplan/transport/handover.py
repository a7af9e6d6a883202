# SPDX-License-Identifier: Apache-2.0
"""Handing a message to the next component at once, besides publishing it.

ROSPlan passes problem, plan text and plan along by latched topics: a stage that is called right after the one
before it may still hold the old message. Components that share a process hand over in the call itself; what
then arrives on the topic from this node is dropped. Between processes the receiver asks the sender for the
digest of its last message, and waits until it has that one.
"""

import hashlib
import io
import threading
from collections import deque
from typing import Any, Callable, ClassVar, Deque, Dict, List, NamedTuple, Optional

import rospy
from std_srvs.srv import Trigger, TriggerRequest, TriggerResponse

from merlin_ros.actions.peers import sender_of
from merlin_ros.master.master_link import ERRORS, bounded_master
from merlin_ros.service_proxy import ServiceError, ServiceProxy

Receiver = Callable[[Any], None]

IN_FLIGHT = 2.0  # s of wall time for a message that was sent and has not arrived
RECENT = 8  # messages that a receiver remembers: another node may publish on the topic too


def digest_service(topic: str) -> str:
    """The service that returns the digest of a sender's last message."""
    return f"{topic}/digest"


class Handed(NamedTuple):
    """A message that was handed over."""

    number: int
    """Counts the messages of this process: a newer one has a larger number."""
    message: Any


class Handover:
    """The topics of this process whose receivers are served directly."""

    _lock: ClassVar[threading.Lock] = threading.Lock()  # guards the registers
    _receivers: ClassVar[Dict[str, List["Subscription"]]] = {}
    _senders: ClassVar[Dict[str, int]] = {}
    _last: ClassVar[Dict[str, "Handed"]] = {}  # message handed over last
    _count = 0  # messages handed over so far

    @classmethod
    def sender(cls, topic: str) -> "Sender":
        """Says that messages on this topic (global name) will be handed over by :meth:`Sender.hand_over`."""
        with cls._lock:
            cls._senders[topic] = cls._senders.get(topic, 0) + 1
        return Sender(topic)

    @classmethod
    def receiver(cls, topic: str, receive: Receiver) -> "Subscription":
        """Receives what is handed over; use :meth:`Subscription.from_topic` as the topic's callback.

        A stage may be called while the next one of its process is still being made: what it has handed over
        before is received at once.
        """
        subscription = Subscription(topic, receive)
        with cls._lock:
            cls._receivers.setdefault(topic, []).append(subscription)
            last = cls._last.get(topic)
        if last is not None:
            subscription.from_sender(last)
        return subscription


class Sender:
    """Hands messages of one topic over."""

    def __init__(self, topic: str) -> None:
        self._topic = topic
        self._last: Optional[Any] = None

    def hand_over(self, message: Any) -> None:
        """Gives the message to every receiver of this process, in the calling thread. Publish it after."""
        self._last = message
        with Handover._lock:
            Handover._count += 1
            handed = Handover._last[self._topic] = Handed(Handover._count, message)
            subscriptions = list(Handover._receivers.get(self._topic, ()))
        for subscription in subscriptions:
            subscription.from_sender(handed)

    def answer_digest(self, _: TriggerRequest) -> TriggerResponse:
        """Callback of :func:`digest_service`; success is whether there was a message."""
        last = self._last
        return TriggerResponse(last is not None, _digest(last) if last is not None else "")

    def shutdown(self) -> None:
        """Ends the direct handover; the topic alone carries the messages."""
        with Handover._lock:
            count = Handover._senders.get(self._topic, 0)
            if count > 1:
                Handover._senders[self._topic] = count - 1
            else:
                Handover._senders.pop(self._topic, None)
                Handover._last.pop(self._topic, None)


class Subscription:
    """Receives the messages of one topic, each once."""

    def __init__(self, topic: str, receive: Receiver) -> None:
        self._topic = topic
        self._receive = receive
        self._order = threading.RLock()  # guards _newest, and keeps messages that are handed over in order
        self._newest = 0  # number of the last one
        self._arrived = threading.Condition()  # guards _recent
        self._recent: Deque[Any] = deque(maxlen=RECENT)
        self._caught_up = ""  # the digest last waited for; only its caller's thread uses it
        self._sender: Optional[ServiceProxy] = None

    def from_sender(self, handed: Handed) -> None:
        """Receives what is handed over; drops what is older than the last one: two threads may hand over."""
        with self._order:
            if handed.number > self._newest:
                self._newest = handed.number
                self._receive(handed.message)

    def from_topic(self, message: Any) -> None:
        """Callback for a rospy.Subscriber of the topic: drops what was handed over already."""
        with Handover._lock:
            handed_over = sender_of(message) == rospy.get_name() and self._topic in Handover._senders
        if not handed_over:
            self._receive(message)
            with self._arrived:
                self._recent.append(message)
                self._arrived.notify_all()

    def catch_up(self, limit: Optional[float] = None) -> None:
        """Waits for what a sender in another process has published and has not arrived.

        A sender without such a service (the original's, a script's) is not waited for.

        :param limit: s of wall time; None: `IN_FLIGHT`.
        """
        limit = IN_FLIGHT if limit is None else limit
        with Handover._lock:
            if self._topic in Handover._senders:
                return
        name = digest_service(self._topic)
        try:
            if self._sender is None:
                self._sender = ServiceProxy(name, Trigger, timeout=IN_FLIGHT)
            if not self._sender.connected:
                bounded_master(limit).lookupService(name)
            answer = self._sender()
        except (*ERRORS, ServiceError):
            return
        if answer.success and answer.message != self._caught_up:
            self._caught_up = answer.message
            with self._arrived:
                self._arrived.wait_for(
                    lambda: any(_digest(message) == answer.message for message in self._recent), limit
                )

    def shutdown(self) -> None:
        """Ends the subscription."""
        with Handover._lock:
            subscriptions = Handover._receivers.get(self._topic, [])
            if self in subscriptions:
                subscriptions.remove(self)


def _digest(message: Any) -> str:
    buffer = io.BytesIO()
    message.serialize(buffer)
    return hashlib.md5(buffer.getbuffer()).hexdigest()

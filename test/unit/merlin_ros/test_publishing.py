# SPDX-License-Identifier: Apache-2.0
import io
import socket
import struct
import threading

import genpy
import pytest
import rospy
from diagnostic_msgs.msg import KeyValue
from rosplan_dispatch_msgs.msg import ActionFeedback
from rosplan_knowledge_msgs.msg import StatusUpdate
from rospy import core, topics

from merlin_ros.publishing import OnSubscriber, publish
from merlin_test import LONG


class Closed:
    """A publisher whose topic is closed."""

    def __init__(self):
        self.published = []

    def publish(self, message):
        self.published.append(message)
        raise rospy.ROSException("publish() to a closed topic")


def test_a_node_that_goes_down_tries_to_publish_and_ignores_a_closed_topic(monkeypatch):
    monkeypatch.setattr(core, "_in_shutdown", True)
    topic = Closed()
    publish(topic, "last words")
    assert topic.published == ["last words"]


def test_a_closed_topic_of_a_running_node_is_reported(monkeypatch):
    monkeypatch.setattr(core, "_in_shutdown", False)
    with pytest.raises(rospy.ROSException, match="closed topic"):
        publish(Closed(), "a message")


class Connection:
    """A subscriber, as rospy's publisher sees it."""

    id = 1
    endpoint_id = "/listener"
    cleanup_cb = None

    def __init__(self):
        self.sent = []

    def write_data(self, data):
        self.sent.append(data)

    def set_cleanup_callback(self, callback):
        pass


@pytest.fixture
def topic(monkeypatch):
    """A publisher with one subscriber."""
    monkeypatch.setattr(topics, "is_initialized", lambda: True)
    publisher = rospy.Publisher.__new__(rospy.Publisher)
    publisher.data_class, publisher.impl = StatusUpdate, topics._PublisherImpl("/status", StatusUpdate)
    publisher.impl.is_latch = True
    publisher.impl.connections = [Connection()]
    return publisher


def wire(name):
    buffer = io.BytesIO()
    StatusUpdate(last_update_client=name).serialize(buffer)
    return struct.pack("<I", len(buffer.getvalue())) + buffer.getvalue()


def test_half_a_character_is_replaced(topic):
    for name in ("before", "caf\udce9", "after"):
        publish(topic, StatusUpdate(last_update_client=name))
    assert topic.impl.connections[0].sent == [wire("before"), wire("caf?"), wire("after")]
    assert topic.impl.latch.last_update_client == "after"


def test_half_a_character_is_replaced_deep_inside(topic):
    topic.data_class = topic.impl.data_class = ActionFeedback
    publish(topic, ActionFeedback(information=[KeyValue("reason", "caf\udce9")]))
    (sent,) = topic.impl.connections[0].sent
    assert b"caf?" in sent


def test_what_cannot_be_written_does_not_spoil_the_next_message(topic):
    publish(topic, StatusUpdate(last_update_client="before"))
    with pytest.raises(rospy.ROSSerializationException):
        publish(topic, StatusUpdate(last_update_client=3))
    assert topic.impl.latch.last_update_client == "before"
    publish(topic, StatusUpdate(last_update_client="after"))
    assert topic.impl.connections[0].sent == [wire("before"), wire("after")]


def test_what_is_latched_for_later_subscribers_can_be_written(topic):
    topic.impl.connections = []
    publish(topic, StatusUpdate(last_update_client="caf\udce9"))
    assert topic.impl.latch.last_update_client == "caf?"
    with pytest.raises(genpy.SerializationError):
        publish(topic, StatusUpdate(last_update_client=3))
    assert topic.impl.latch.last_update_client == "caf?"


def test_what_a_new_subscriber_gets_is_not_mixed_with_what_is_published_meanwhile(topic):
    begun, published = threading.Event(), threading.Event()

    class Slow(StatusUpdate):
        def serialize(self, buffer):
            super().serialize(buffer)
            begun.set()
            published.wait(0.5)  # it comes only after this: no event says that it waits

    def publish_meanwhile():
        begun.wait(LONG)
        publish(topic, StatusUpdate(last_update_client="to all"))
        published.set()

    other = threading.Thread(target=publish_meanwhile, daemon=True)
    other.start()
    subscriber = Connection()
    topic.impl.connections, topic.impl.is_latch = [], False
    topic.impl.subscriber_listeners = [OnSubscriber(lambda one: one(Slow(last_update_client="welcome")))]
    ours, theirs = socket.socketpair()
    with ours, theirs:
        subscriber.fileno = ours.fileno
        topic.impl.add_connection(subscriber)
        other.join(LONG)
    assert subscriber.sent == [wire("welcome"), wire("to all")]

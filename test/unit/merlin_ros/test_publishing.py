import pytest
import rospy
from rospy import core

from merlin_ros.publishing import publish


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

import pytest
import rospy
from rospy import core

from merlin_ros.publishing import publish


class Closed:
    def publish(self, _):
        raise rospy.ROSException("publish() to a closed topic")


def test_a_closed_topic_of_a_node_that_goes_down_is_nobodys_concern(monkeypatch):
    monkeypatch.setattr(core, "_in_shutdown", True)
    publish(Closed(), None)


def test_a_closed_topic_of_a_running_node_is_reported(monkeypatch):
    monkeypatch.setattr(core, "_in_shutdown", False)
    with pytest.raises(rospy.ROSException):
        publish(Closed(), None)

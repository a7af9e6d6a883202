# SPDX-License-Identifier: Apache-2.0
"""A topic of a node that is held up while it makes it: no message is lost by that."""

from typing import Any

import pytest

pytestmark = pytest.mark.processes

TALKER = """
import rospy
from std_msgs.msg import String
from merlin_ros.node import init_node
from merlin_ros.publishing import OnSubscriber
{stall}
init_node("talker")
welcome = OnSubscriber(lambda publish: publish(String("welcome")))
topics = [
    rospy.Publisher("/greeted", String, subscriber_listener=welcome, queue_size=1),
    rospy.Publisher("/latched", String, latch=True, queue_size=1),
]
topics[1].publish("latched")
print("talks", flush=True)
rospy.spin()
"""
LISTENER = """
import rospy
from std_msgs.msg import String
from merlin_ros.node import init_node
{stall}
init_node("listener")
topics = [
    rospy.Subscriber(name, String, lambda message: print("heard", message.data, flush=True))
    for name in ("/greeted", "/latched")
]
print("listens", flush=True)
rospy.spin()
"""
# Until the other node has connected, and in vain where it has not been named to it.
STALL = """
import time
from rospy import topics as implementation
def stall(kind, name, reached):
    make = getattr(kind, name)
    def late(topic, *args):
        end = time.monotonic() + 1.0
        while not reached(topic) and time.monotonic() < end:
            time.sleep(0.01)
        make(topic, *args)
    setattr(kind, name, late)
"""
STALL_TALKER = """
stall(implementation._PublisherImpl, "add_subscriber_listener", lambda topic: topic.has_connections())
"""
STALL_LISTENER = """
stall(
    implementation._SubscriberImpl,
    "add_callback",
    lambda topic: any(link.stat_num_msg for link in topic.connections),
)
"""


def test_a_subscriber_is_there_before_the_publisher_is_made(master: Any) -> None:
    listener = master.node(LISTENER.format(stall=""))
    listener.expect("listens")
    master.node(TALKER.format(stall=STALL + STALL_TALKER))
    listener.expect("heard welcome")
    assert listener.end() == 0


def test_a_publisher_is_there_before_the_subscriber_is_made(master: Any) -> None:
    master.node(TALKER.format(stall="")).expect("talks")
    listener = master.node(LISTENER.format(stall=STALL + STALL_LISTENER))
    for _ in range(2):
        listener.expect("heard")
    assert sorted(line for line in listener.lines if "heard" in line) == ["heard latched", "heard welcome"]
    assert listener.end() == 0

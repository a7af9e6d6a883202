"""Which publishers send to this node. rospy's own count says so before the connection is open."""

import time

import rospy

from merlin_ros.master.master_link import ERRORS, bounded_master, bounded_proxy

LONG = 120.0


def publishers_of(subscriber):
    """The nodes that send to this node: it hears of a connection before its publisher uses it."""
    name, me = subscriber.resolved_name, rospy.get_name()
    nodes = dict(bounded_master().getSystemState()[0]).get(name, [])
    return {node for node in nodes if sends(node, name, me)}


def sends(node, topic, other):
    """Whether a node sends a topic to another one."""
    try:
        entries = bounded_proxy(bounded_master().lookupNode(node), LONG).getBusInfo(rospy.get_name())[2]
    except ERRORS:  # it has ended
        return False
    return any((entry[1], entry[2], entry[4]) == (other, "o", topic) for entry in entries)


def wait_for_publisher(subscriber, node):
    """Waits until a node sends to a subscriber."""
    while node not in publishers_of(subscriber):
        rospy.rostime.wallsleep(0.01)


def wait_for_publishers(*subscribers, count=1):
    """Waits until so many nodes send to each of the subscribers."""
    end = time.monotonic() + LONG
    for subscriber in subscribers:
        while len(publishers_of(subscriber)) < count:
            assert time.monotonic() < end, f"{subscriber.resolved_name}: {publishers_of(subscriber)}"
            rospy.rostime.wallsleep(0.01)

# SPDX-License-Identifier: Apache-2.0
"""Links of a test: which publishers send to this node, and services that a busy machine brings late.

rospy's own count of publishers has a connection before it is open.
"""

import time
from typing import Any, Optional, Set, Union

import rospy

from merlin_ros.lean_start import end_lightly, log_configured
from merlin_ros.master import announcing, publisher_updates
from merlin_ros.master.master_link import ERRORS, bound_calls, bounded_master, bounded_proxy
from merlin_ros.service_proxy import ServiceProxy
from merlin_test import LONG


def init_node(name: str, **options: Any) -> None:
    """Makes the process a plain node of rospy, but one that loses no publisher and no message.

    What it uses of MERLIN waits longer for a slow master than a node does.

    :param options: of `rospy.init_node`.
    """
    publisher_updates.keep_all()
    announcing.announce_complete()
    bound_calls(LONG)
    end_lightly()
    with log_configured():
        rospy.init_node(name, **options)


def publishers_of(subscriber: rospy.Subscriber) -> Set[str]:
    """The nodes that send to this node: it hears of a connection before its publisher uses it."""
    name, me = subscriber.resolved_name, rospy.get_name()
    state: Any = bounded_master(LONG).getSystemState()
    return {node for node in dict(state[0]).get(name, []) if sends(node, name, me)}


def sends(node: str, topic: str, other: str) -> bool:
    """Whether a node sends a topic to another one."""
    try:
        uri: Any = bounded_master(LONG).lookupNode(node)
        info: Any = bounded_proxy(uri, LONG).getBusInfo(rospy.get_name())
    except ERRORS:  # it has ended
        return False
    return any((entry[1], entry[2], entry[4]) == (other, "o", topic) for entry in info[2])


def pid_of(node: str) -> int:
    """The process id of a node."""
    uri: Any = bounded_master(LONG).lookupNode(node)
    found: Any = bounded_proxy(uri, LONG).getPid(rospy.get_name())
    return found[2]


def wait_for_publisher(subscriber: rospy.Subscriber, node: str) -> None:
    """Waits until a node sends to a subscriber."""
    end = time.monotonic() + LONG
    while node not in publishers_of(subscriber):
        assert time.monotonic() < end, f"{node} does not send {subscriber.resolved_name}"
        rospy.rostime.wallsleep(0.01)


def wait_for_publishers(*subscribers: rospy.Subscriber, count: int = 1) -> None:
    """Waits until so many nodes send to each of the subscribers."""
    end = time.monotonic() + LONG
    for subscriber in subscribers:
        while len(publishers_of(subscriber)) < count:
            assert time.monotonic() < end, f"{subscriber.resolved_name}: {publishers_of(subscriber)}"
            rospy.rostime.wallsleep(0.01)


def wait_for_connections(*links: Union[rospy.Publisher, rospy.Subscriber], count: int = 1) -> None:
    """Waits until each publisher has so many subscribers, and each subscriber so many publishers."""
    end = time.monotonic() + LONG
    for link in links:
        while link.get_num_connections() < count:
            assert time.monotonic() < end, f"{link.resolved_name}: {link.get_num_connections()} connections"
            rospy.rostime.wallsleep(0.01)


def patient_service(name: str, service_class: type, timeout: Optional[float] = None) -> ServiceProxy:
    """A proxy whose first call waits for the start of the server, and for a slow master.

    :param timeout: longest wait for an answer, s of wall time; None: as long as it takes.
    """
    return ServiceProxy(name, service_class, timeout, patience=LONG)

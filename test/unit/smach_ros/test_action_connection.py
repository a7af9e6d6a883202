"""When an action server counts as connected: never by the links of a process that has ended."""

import socket
import threading
from types import SimpleNamespace

import pytest
import rospy
from actionlib_msgs.msg import GoalStatusArray

from smach_ros.action_connection import ActionConnection

SERVER = "/move_base"


class Links:
    """A publisher or subscriber, by its links to processes of one name."""

    def __init__(self):
        self.impl = SimpleNamespace(connections=[])
        self._others = []

    def open(self):
        """The newest process connects."""
        own, other = socket.socketpair()
        self.impl.connections.append(SimpleNamespace(socket=own, endpoint_id=SERVER, callerid_pub=SERVER))
        self._others.append(other)

    def die(self):
        """All processes end; rospy keeps what it has not yet noticed."""
        for other in self._others:
            other.close()

    def close(self):
        for link in self.impl.connections:
            link.socket.close()
        self.die()


@pytest.fixture
def links():
    made = {name: Links() for name in ("goal_publisher", "cancel_publisher")}
    made.update((name, Links()) for name in ("result_subscriber", "status_subscriber"))
    yield made
    for each in made.values():
        each.close()


@pytest.fixture
def connection(links, monkeypatch):
    monkeypatch.setattr(rospy, "get_time", lambda: 0.0)
    made = ActionConnection.__new__(ActionConnection)
    made.changed, made._goals, made._server, made._proved = threading.Condition(), {}, "", None
    for name, each in links.items():
        setattr(made, f"_{name}", each)
    return made


def status(connection):
    message = GoalStatusArray()
    message._connection_header = {"callerid": SERVER}
    connection._receive_status(message)


def test_a_server_that_was_restarted_is_ready_after_a_status_of_its_own(connection, links):
    for each in links.values():
        each.open()
    assert not connection.ready()
    status(connection)
    assert connection.ready()
    for each in links.values():
        each.die()
    assert not connection.ready()
    for each in links.values():
        each.open()
    assert not connection.ready(), "its link for results may not take any yet"
    status(connection)
    assert connection.ready()


def test_a_status_before_the_link_for_results_proves_nothing(connection, links):
    for name, each in links.items():
        if name != "result_subscriber":
            each.open()
    status(connection)
    links["result_subscriber"].open()
    assert not connection.ready()
    status(connection)
    assert connection.ready()

# SPDX-License-Identifier: Apache-2.0
"""When an action server counts as connected: never by the links of a process that has ended."""

import socket
from types import SimpleNamespace

import pytest
import rospy
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal

from smach_ros import action_connection
from smach_ros.action_connection import GONE, GREETED, LATE_RESULT, LONGEST_LOOK, SILENCE, ActionConnection

SERVER = "/move_base"


class Links:
    """A publisher or subscriber, by its links to processes of one name."""

    def __init__(self):
        self.impl = SimpleNamespace(connections=[])
        self._others = []
        self.receive = None  # the callback of a subscriber

    def get_num_connections(self):
        return len(self.impl.connections)

    def publish(self, message):
        """Takes a message."""

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


class Time:
    """The wall's clock and that of ROS, set by a test."""

    wall = ros = 100.0

    def monotonic(self):
        return self.wall

    def pass_by(self, seconds):
        self.wall += seconds
        self.ros += seconds


@pytest.fixture
def clocks(monkeypatch):
    made = Time()
    monkeypatch.setattr(action_connection, "time", made)
    monkeypatch.setattr(rospy, "get_time", lambda: made.ros)
    monkeypatch.setattr(rospy.Time, "now", lambda: rospy.Time.from_sec(made.ros))
    return made


@pytest.fixture
def connection(links, clocks, monkeypatch):
    def link(topic, _, callback, **__):
        kind = topic.rpartition("/")[2]
        made = links[f"{kind}_publisher" if kind in ("goal", "cancel") else f"{kind}_subscriber"]
        made.receive = callback
        return made

    monkeypatch.setattr(rospy, "Publisher", link)
    monkeypatch.setattr(rospy, "Subscriber", link)
    return ActionConnection(SERVER, MoveBaseAction)


def status(links, *statuses):
    message = GoalStatusArray(status_list=list(statuses))
    message._connection_header = {"callerid": SERVER}
    links["status_subscriber"].receive(message)


def statuses(links, clocks):
    """The server publishes its status, and again after a period."""
    status(links)
    clocks.pass_by(0.2)
    status(links)


def test_a_server_that_was_restarted_is_ready_after_statuses_of_its_own(connection, clocks, links):
    for each in links.values():
        each.open()
    assert not connection.ready()
    statuses(links, clocks)
    assert connection.ready()
    for each in links.values():
        each.die()
    assert not connection.ready()
    for each in links.values():
        each.open()
    assert not connection.ready(), "its link for results may not take any yet"
    statuses(links, clocks)
    assert connection.ready()


@pytest.mark.parametrize(
    "topic", ["goal_publisher", "cancel_publisher", "result_subscriber", "status_subscriber"]
)
def test_a_link_to_a_server_that_has_ended_does_not_count_for_its_successor(topic, connection, clocks, links):
    for each in links.values():
        each.open()
    statuses(links, clocks)
    assert connection.ready()
    links[topic].die()
    assert not connection.ready()
    links[topic].open()
    assert connection.ready() is (topic != "result_subscriber"), "a status comes before it"
    statuses(links, clocks)
    assert connection.ready()


def test_statuses_before_the_link_for_results_or_of_one_moment_prove_nothing(connection, clocks, links):
    for name, each in links.items():
        if name != "result_subscriber":
            each.open()
    status(links)
    links["result_subscriber"].open()
    assert not connection.ready()
    for _ in range(3):
        status(links)
        assert not connection.ready(), "it may have been greeted only"
    clocks.pass_by(0.2)
    status(links)
    assert connection.ready()


def test_while_the_clock_of_ros_stands_the_link_for_results_counts_after_a_while(connection, clocks, links):
    """actionlib's server publishes its status by ROS time: only the latched one comes, here as the first."""
    for name, each in links.items():
        if name != "result_subscriber":
            each.open()
    status(links)
    clocks.wall += 10 * GREETED
    links["result_subscriber"].open()
    assert not connection.ready()
    clocks.wall += GREETED
    assert connection.ready()
    links["result_subscriber"].close()
    assert not connection.ready()
    links["result_subscriber"].open()
    assert not connection.ready(), "that of the next process"
    clocks.wall += GREETED
    assert connection.ready()


LOOK = 0.5  # s between two looks of a state


def watch(connection, clocks, goal, seconds):
    """A state looks for some time; returns why its server is lost."""
    for _ in range(round(seconds / LOOK)):
        clocks.pass_by(LOOK)
        connection.settle(goal)
        connection.why_lost(goal)
    return connection.why_lost(goal)


@pytest.fixture
def goal(connection, links):
    """A goal that the server has acknowledged."""
    for each in links.values():
        each.open()
    sent = connection.send(MoveBaseGoal())
    status(links, GoalStatus(goal_id=GoalID(id=sent.id), status=GoalStatus.ACTIVE))
    return sent


def test_a_server_that_is_silent_for_enough_looks_is_lost(connection, clocks, goal):
    assert not watch(connection, clocks, goal, SILENCE)
    assert "has been silent" in watch(connection, clocks, goal, LOOK)


def test_a_process_that_was_stalled_has_heard_no_silence(connection, clocks, goal):
    clocks.pass_by(10.0)
    assert not connection.why_lost(goal)
    assert "has been silent" in watch(connection, clocks, goal, SILENCE)


def test_a_server_whose_connection_closed_is_gone_after_enough_looks(connection, clocks, goal, links):
    links["status_subscriber"].impl.connections.clear()
    clocks.pass_by(10.0)
    assert not connection.why_lost(goal)
    assert "is gone" in watch(connection, clocks, goal, GONE)


def test_the_server_of_a_goal_that_was_sent_before_a_stall_may_acknowledge_it(connection, clocks, links):
    links["status_subscriber"].open()
    sent = connection.send(MoveBaseGoal())
    clocks.pass_by(10.0)
    status(links)
    assert not connection.why_lost(sent)


def test_a_result_waits_for_a_process_that_was_stalled(connection, clocks, goal, links):
    status(links, GoalStatus(goal_id=GoalID(id=goal.id), status=GoalStatus.SUCCEEDED))
    clocks.pass_by(10.0)
    connection.settle(goal)
    assert not goal.done
    watch(connection, clocks, goal, LATE_RESULT)
    assert goal.done and goal.status == GoalStatus.SUCCEEDED


def test_a_paused_simulator_makes_no_server_silent(connection, clocks, goal):
    for _ in range(100):
        clocks.wall += LONGEST_LOOK
        assert not connection.why_lost(goal)


def test_stamps_never_decrease_and_follow_what_the_server_has_taken(connection, clocks, monkeypatch, links):
    sent = []
    monkeypatch.setattr(links["goal_publisher"], "publish", sent.append)
    connection.send(MoveBaseGoal())
    clocks.ros -= 30.0
    connection.send(MoveBaseGoal())
    status(links, GoalStatus(goal_id=GoalID(id="of another process", stamp=rospy.Time(500))))
    connection.send(MoveBaseGoal())
    assert [goal.goal_id.stamp.to_sec() for goal in sent] == [100.0, 100.0, 500.0]

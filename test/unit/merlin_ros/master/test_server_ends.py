# SPDX-License-Identifier: Apache-2.0
"""An action server whose node ends: nothing begins any more, and a master that hangs does not hold it up."""

import signal
import threading
from typing import Any, List

import pytest
import rospy
from actionlib_msgs.msg import GoalID, GoalStatus
from fakes.topics import Topics
from merlin_msgs.msg import ListenAction, ListenActionGoal

from merlin_ros import publishing
from merlin_ros.actions.action_server import ActionServer, ServerGoal
from merlin_test import LONG

SERVES = """
import sys, rospy, smach
from merlin_msgs.msg import ListenAction
from merlin_ros.actions.action_client import ActionClient
from merlin_ros.actions.serial_action_server import SerialActionServer
from merlin_ros.node import run_node
from merlin_sm.introspection import start_introspection
def start():
    for number in range(4):
        server = SerialActionServer(f"listen{number}", ListenAction, lambda goal: None)
        server.start()
        rospy.on_shutdown(server.shutdown)
        rospy.on_shutdown(ActionClient(f"say{number}", ListenAction).shutdown)
        rospy.on_shutdown(start_introspection(f"MACHINE{number}", smach.StateMachine(["done"])).stop)
    def run():
        print("serves", flush=True)
        rospy.spin()
    return run
sys.exit(run_node("server", start))
"""


@pytest.mark.processes
def test_servers_end_in_order_though_the_master_hangs(master: Any) -> None:
    node = master.node(SERVES)
    node.expect("serves")
    master.process.send(signal.SIGSTOP)
    code = node.end()
    assert (code, "is ended by force" in node.output) == (0, False), node.output


class Server:
    """Serves `listen`, and holds its clients' goals."""

    def __init__(self, topics: Topics) -> None:
        self.topics = topics
        self.goals: List[ServerGoal] = []
        self.server = ActionServer("listen", ListenAction, self.goals.append, lambda goal: None)
        self.server.start()

    def send(self, name: str) -> None:
        goal_id = GoalID(id=name, stamp=rospy.Time(1))
        self.topics.send("/listen/goal", ListenActionGoal(goal_id=goal_id))


def test_a_goal_that_comes_while_the_server_of_a_node_that_ends_is_closed_does_not_begin(
    clock: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(publishing, "is_shutdown_requested", lambda: True)

    def before(topic: str, message: Any) -> None:
        if topic == "/listen/result" and not late:  # of the first goal, which the end has aborted
            late.append(threading.Thread(target=server.send, args=("second",), daemon=True))
            late[0].start()

    late: List[threading.Thread] = []
    server = Server(Topics(monkeypatch))
    server.send("first")
    server.topics.before = before
    server.server.shutdown()
    late[0].join(LONG)
    assert not late[0].is_alive()
    assert [(goal.id, goal.status) for goal in server.goals] == [("first", GoalStatus.ABORTED)]

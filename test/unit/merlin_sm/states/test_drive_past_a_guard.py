# SPDX-License-Identifier: Apache-2.0
"""Drives of plain actionlib servers, as a real guard and the states of MERLIN see them."""

from typing import Any, Callable

import pytest

from merlin_test.node_path import node_path

pytestmark = pytest.mark.processes

# Two servers that never send a velocity.
SERVERS = """
import threading
import actionlib, rospy
from move_base_msgs.msg import MoveBaseAction

rospy.init_node("driver")

def serve(name):
    stopped = threading.Event()

    def execute(goal):
        stopped.wait()
        stopped.clear()
        server.set_preempted()

    server = actionlib.SimpleActionServer(name, MoveBaseAction, execute, auto_start=False)
    server.register_preempt_callback(stopped.set)
    server.start()

serve("move_base")
serve("dock")
print("SERVES", flush=True)
rospy.spin()
"""

CLIENT = """
import rospy, socket, sys
from geometry_msgs.msg import PoseStamped
from merlin_msgs.msg import GuardStatus
from move_base_msgs.msg import MoveBaseAction, MoveBaseActionGoal, MoveBaseGoal
from merlin_sm.states.action_state import ActionState
from merlin_sm.states.navigation import NavigationState
from smach import UserData

rospy.init_node("client")
states = {
    "navigation": NavigationState(PoseStamped(), server_wait=60.0),
    "action": ActionState("dock", MoveBaseAction, MoveBaseGoal(), server_wait=60.0),
}

def cut(goal):
    for link in guard.impl.connections:
        link.socket.shutdown(socket.SHUT_RDWR)

guard = rospy.Subscriber("merlin/guard", GuardStatus)  # rospy shares its connection with the states
if "cut" in sys.argv:
    rospy.Subscriber("dock/goal", MoveBaseActionGoal, cut)
print("READY", flush=True)
for name in sys.stdin:
    state = states[name.strip()]
    print("END", state.execute(UserData()), state.reason, flush=True)
"""


def start(master: Any, *arguments: str) -> Callable[[str], str]:
    """Starts guard, servers and client; what it returns runs a state to its end."""
    master.api.setParam("/test", "/merlin/guard_expected", True)
    options = ("_motion_servers:=[move_base, dock]", "_no_command_after:=0.2", "_no_command_limit:=0.4")
    master.spawn(node_path("merlin_guard", "guard"), *options)
    master.node(SERVERS).expect("SERVES")
    client = master.node(CLIENT, *arguments)
    client.expect("READY")

    def run(kind: str) -> str:
        client.process.stdin.write(f"{kind}\n")
        client.process.stdin.flush()
        return str(client.expect("END"))

    return run


@pytest.mark.parametrize("kind, server", [("navigation", "/move_base"), ("action", "/dock")])
def test_a_server_that_sends_no_velocity_is_given_up_by_name(master: Any, kind: str, server: str) -> None:
    run = start(master)
    for _ in range(2):  # the time of the first goal is not that of the second
        assert run(kind).startswith(f"END aborted {server} had an active goal and sent no velocity")
    master.tool("rosservice", "call", "/merlin/stop").ended()
    assert run(kind).startswith("END aborted the velocity guard has stopped the base")


def test_a_plain_node_whose_connection_to_the_guard_breaks_hears_it_again(master: Any) -> None:
    run = start(master, "cut")
    assert run("action").startswith("END aborted /dock had an active goal and sent no velocity")

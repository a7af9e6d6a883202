# SPDX-License-Identifier: Apache-2.0
"""A whole robot as processes: its master dies while it drives, and a second launch of it is started."""

import time
from typing import Any, Dict

import pytest

from merlin.local_names import launch_tool
from merlin_test import LONG

pytestmark = pytest.mark.processes

NODES = (
    "/merlin_executor", "/planning_system", "/merlin_bridges", "/merlin_fsm_host", "/merlin_guard", "/base",
    "/speech", "/witness",
)  # fmt: skip

# Wants goals, one for each line of its input, and prints what the base is commanded behind the guard.
WITNESS = """
import sys, threading, rospy
from geometry_msgs.msg import Twist
from merlin_executor.executor_client import MerlinExecutorClient, outcome_name
from merlin_ros.node import run_node
from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant

class Base:
    def __init__(self):
        self.moves = False
        rospy.Subscriber("cmd_vel", Twist, self.receive, tcp_nodelay=True)

    def receive(self, velocity):
        moves = velocity != Twist()
        if moves != self.moves:
            print("MOVES" if moves else "STANDS", flush=True)
        self.moves = moves

def start():
    Base()
    client, knowledge = MerlinExecutorClient(), MerlinROSPlanAssistant()
    assert client.wait_for_executor(300)
    knowledge.facts("robot_at")  # connects: without a master nothing is found
    print("started", flush=True)
    def tell(request):
        result = request.result
        places = ", ".join(knowledge.facts("robot_at"))
        print(f"ENDED {outcome_name(result.outcome)}: {result.reason}; places {places}", flush=True)
    def run():
        for line in sys.stdin:
            client.send(line.strip(), on_done=tell)
    return run
sys.exit(run_node("witness", start))
"""


@pytest.fixture
def launch(master: Any) -> Any:
    """The robot, on the test's own master."""
    robot = master.spawn(*launch_tool("roslaunch"), "merlin_test", "whole_robot.launch")
    yield robot
    robot.end()


@pytest.fixture
def witness(master: Any, launch: Any) -> Any:
    found = master.node(WITNESS)
    found.expect("started")
    return found


def addresses(master: Any) -> Dict[str, str]:
    """Where the nodes are, when the master knows all of them."""
    end = time.monotonic() + LONG
    while True:
        found = {node: master.address_of(node) for node in NODES}
        if all(found.values()):
            return found
        assert time.monotonic() < end, f"not all nodes are there: {found}"
        time.sleep(0.1)


def begun_to_work(witness: Any) -> None:
    """Waits until a first goal is reached: rospy connects to a node that starts at growing intervals."""
    end = time.monotonic() + LONG
    while True:
        witness.say("(checked bathroom)")
        answer = witness.expect("ENDED")
        if "ENDED SUCCEEDED" in answer:
            return
        assert time.monotonic() < end, answer


def launch_again_in_vain(master: Any) -> None:
    second = master.spawn(*launch_tool("roslaunch"), "merlin", "executor.launch")
    second.ended()  # roslaunch has no exit code for this
    assert "node /merlin_executor runs already (process " in second.output
    assert "end that one first, or name this one differently with __name:=" in second.output
    assert "Traceback" not in second.output
    whole = master.spawn(*launch_tool("roslaunch"), "merlin_test", "whole_robot.launch")
    whole.ended()
    assert " runs already" in whole.output


def test_neither_a_second_launch_nor_the_loss_of_the_master_harms_a_robot(master: Any, witness: Any) -> None:
    """It goes on beside a second one, stands without a master, and works again with the next one."""
    before = addresses(master)
    begun_to_work(witness)
    launch_again_in_vain(master)
    assert {node: master.address_of(node) for node in NODES} == before
    witness.say("(checked dorm_room)")
    assert "ENDED SUCCEEDED" in witness.expect("ENDED")
    witness.say("(checked kitchen)")
    witness.expect("MOVES")
    master.kill()
    witness.expect("STANDS")
    first = witness.expect("ENDED")
    assert "the ROS master did not return within 8 s" in first, first
    assert first.count("(robot_at ") == 1, first
    master.start()
    addresses(master)
    witness.say("(checked kitchen)")
    witness.expect("MOVES")
    second = witness.expect("ENDED")
    assert "ENDED SUCCEEDED" in second, second
    assert second.endswith("places (robot_at kitchen)"), second

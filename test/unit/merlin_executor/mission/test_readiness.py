# SPDX-License-Identifier: Apache-2.0
"""A mission waits for the robots of its plan, names those that are missing, and can be interrupted."""

import signal
from typing import Any, List

import pytest

from merlin_executor.mission.readiness import servers_of

pytestmark = pytest.mark.processes

#: Waits for ria and tom; a line of its input is a word of a robot's host: the robot, and its state.
WAITER = """
import sys, threading
from types import SimpleNamespace
import rospy
from merlin_msgs.msg import RobotHost
from merlin_executor import announced
from merlin_executor.mission import readiness
from merlin_ros.node import init_node

init_node("mission")
rospy.set_param("merlin/robots", ["ria", "tom"])
announced.PATIENCE = 0.2
known, connected = {"tom"}, threading.Event()

class Connected(rospy.SubscribeListener):
    def peer_subscribe(self, *_):
        connected.set()

publisher = rospy.Publisher("/kb/robots", RobotHost, Connected(), queue_size=10)

def speak():
    for line in sys.stdin:
        robot, state = line.split()
        if state == "available":
            known.add(robot)
        out = "is out" if state == "out" else ""
        connected.wait()
        publisher.publish(RobotHost(robot=robot, leaving=state == "leaving", out=out))

threading.Thread(target=speak, name="speak", daemon=True).start()

def query(items):
    robot = items[0].values[0].value
    print("asked for", robot, flush=True)
    return [robot in known]

counted = SimpleNamespace(typed_parameters=["r"])
knowledge = SimpleNamespace(
    name="/kb",
    predicates=lambda: {"available": counted},
    query=query,
    wait=lambda limit: True,
    operators=dict,
)
executor = SimpleNamespace(name="/merlin/execute", wait_for_executor=lambda limit: True)
try:
    readiness.wait_for_robot(knowledge, executor, None, (), float(sys.argv[1]))
    print("wait is over", flush=True)
except readiness.NotReady as error:
    print("not ready:", error, flush=True)
"""


def test_it_waits_until_each_robot_takes_actions_or_is_taken_out(master: Any) -> None:
    waiter = master.node(WAITER, "600")
    waiter.expect("the mission waits for the robots ria, tom, for 600 s in all")
    waiter.say("tom out")
    for _ in range(2):
        waiter.say("ria heard")  # its host lives, and the knowledge does not say so yet
        waiter.expect("asked for ria")
    waiter.say("ria available")
    waiter.expect("wait is over")
    assert waiter.output.count("the mission waits") == 1


def test_it_begins_without_those_that_do_not_come(master: Any) -> None:
    waiter = master.node(WAITER, "5")
    waiter.expect("the mission waits for the robots ria, tom, for 5 s in all")
    waiter.say("tom leaving")
    waiter.say("ria available")
    waiter.expect("the mission begins without tom, which did not come after 5 s")
    waiter.expect("wait is over")


def test_without_any_it_does_not_begin(master: Any) -> None:
    waiter = master.node(WAITER, "1")
    waiter.expect("not ready: no host of the robots ria, tom takes actions after 1 s; are they launched?")


def test_a_wait_ends_with_its_node(master: Any) -> None:
    waiter = master.node(WAITER, "600")
    waiter.expect("the mission waits for the robots")
    waiter.process.send_signal(signal.SIGINT)
    waiter.expect("not ready")


def test_plain_names_of_servers_are_those_of_each_robot() -> None:
    servers = ("move_base", "calls/listen")
    assert servers_of(servers, []) == ["move_base", "calls/listen"]
    assert servers_of(servers, ["ria", "tom"]) == ["ria/move_base", "tom/move_base", "calls/listen"]


# Waits for the server of an action, which a remapping may name anew; it is that server itself.
SERVER_WAITER = """
import sys
import rospy
from actionlib_msgs.msg import GoalStatusArray
from merlin_executor.mission.readiness import missing_servers
from merlin_ros.node import init_node

init_node("mission")
server = rospy.Publisher("/base/drive/status", GoalStatusArray, latch=True, queue_size=1)
server.publish(GoalStatusArray())
print("missing", missing_servers(["move_base"], float(sys.argv[1])), flush=True)
"""


@pytest.mark.parametrize(
    ("limit", "words", "missing"), [("60", ["move_base:=/base/drive"], []), ("0.2", [], ["move_base"])]
)
def test_a_server_is_waited_for_under_the_name_that_a_launch_file_gives_it(
    master: Any, limit: str, words: List[str], missing: List[str]
) -> None:
    assert master.node(SERVER_WAITER, limit, *words).expect("missing") == f"missing {missing}"

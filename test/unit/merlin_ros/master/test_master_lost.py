# SPDX-License-Identifier: Apache-2.0
"""Nodes notice that their master is lost, say so, and work together again when one is back."""

import contextlib
import os
import signal
import time
from typing import Any, List, Tuple

import pytest

from merlin_ros.master.master_watch import HUNG
from merlin_test import LONG
from merlin_test.node_path import node_path

pytestmark = pytest.mark.processes

NOTICE = 5.0  # s within which each node promises to notice
STALL = 20.0  # s that a busy machine may add

# A server of everything: a topic, a service, an action; parameters of its own.
SERVER = """
import sys, rospy
from move_base_msgs.msg import MoveBaseAction
from std_msgs.msg import Int32
from std_srvs.srv import Trigger, TriggerResponse
from merlin_actions.testing.behaviour import Behaviour
from merlin_actions.testing.simulated_action_server import SimulatedActionServer
from merlin_ros.node import keep_params, on_master_back, on_master_lost, run_node

def start():
    rospy.set_param("~depth/of", {"a": 1, "b": [1, 2.5]})
    rospy.set_param("/somewhere/else", "kept")
    on_master_lost(lambda: print("LOST", flush=True))
    on_master_back(lambda: print("BACK", flush=True))
    server = SimulatedActionServer("drive", MoveBaseAction, Behaviour(duration=0.1))
    server.start()
    start.service = rospy.Service("ask", Trigger, lambda _: TriggerResponse(True, "told"))
    topic = rospy.Publisher("count", Int32, queue_size=10)
    start.passing = rospy.Subscriber("passing", Int32, lambda _: None)
    start.passing.unregister()
    keep_params("/somewhere")
    print("started", flush=True)
    def run():
        count = 0
        while not rospy.is_shutdown():
            count += 1
            topic.publish(count)
            rospy.rostime.wallsleep(0.05)
    return run
sys.exit(run_node("server", start))
"""

# Uses all of it once for each line of its input, with clients that exist and with new ones.
CLIENT = """
import sys, rospy
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal
from std_msgs.msg import Int32
from std_srvs.srv import Trigger
from merlin_ros.actions.action_client import ActionClient
from merlin_ros.node import on_master_back, on_master_lost, run_node
from merlin_ros.service_proxy import ServiceProxy

def round(ask, drive):
    rospy.wait_for_message("count", Int32, 300.0)
    assert ask().message == "told"
    assert drive.wait_for_server(300.0)
    goal = drive.send(MoveBaseGoal())
    assert goal.wait(300.0), "no result"
    assert goal.status == 3, goal.status

def start():
    on_master_lost(lambda: print("LOST", flush=True))
    on_master_back(lambda: print("BACK", flush=True))
    ask, drive = ServiceProxy("ask", Trigger, 100, 100), ActionClient("drive", MoveBaseAction)
    def run():
        for line in sys.stdin:
            round(ask, drive)
            round(ServiceProxy("ask", Trigger, 100, 100), ActionClient("drive", MoveBaseAction))
            print("ROUND", flush=True)
    return run
sys.exit(run_node("client", start))
"""


@pytest.fixture
def nodes(master: Any) -> Tuple[Any, Any]:
    master.api.setParam("/test", "/use_sim_time", False)
    server, client = master.node(SERVER), master.node(CLIENT)
    server.expect("started")
    client.say("go")
    client.expect("ROUND")
    return server, client


def outsiders_are_served(master: Any) -> None:
    """Programs that start now find the nodes through the master."""
    echo = master.tool("rostopic", "echo", "-n", "1", "/count")
    echo.expect("data:")
    call = master.tool("rosservice", "call", "/ask")
    call.expect("told")


def test_nodes_work_together_at_a_master_that_was_started_anew(master: Any, nodes: Tuple[Any, Any]) -> None:
    master.kill()
    killed = time.monotonic()
    for node in nodes:
        node.expect("LOST")
    assert time.monotonic() - killed < NOTICE + STALL
    master.start()
    for node in nodes:
        node.expect("BACK")
    nodes[1].say("go")
    nodes[1].expect("ROUND")
    outsiders_are_served(master)
    assert master.api.getParam("/test", "/server/depth/of")[2] == {"a": 1, "b": [1, 2.5]}
    assert master.api.getParam("/test", "/somewhere/else")[2] == "kept"
    assert master.api.getParam("/test", "/use_sim_time")[:1] == [1]
    for node in nodes:
        assert node.end() == 0
        assert "Traceback" not in node.output
    assert not any(name in str(master.api.getSystemState("/test")) for name in ("/server", "/client"))


def test_what_a_launch_file_says_to_all_nodes_is_known_at_a_master_that_was_started_anew(master: Any) -> None:
    """A mission that begins there would look for the servers of one robot, and a drive for no guard."""
    master.api.setParam("/test", "/use_sim_time", False)
    said = {"robots": ["ria", "tom"], "guard_expected": True, "panels": {"why": "merlin_explain:WhyPanel"}}
    master.api.setParam("/test", "/merlin", said)
    node = master.node(SERVER)
    node.expect("started")
    master.kill()
    node.expect("LOST")
    master.start()
    node.expect("BACK")
    assert master.api.getParam("/test", "/merlin")[2] == said


def test_a_parameter_that_was_set_anew_is_left_alone(master: Any, nodes: Tuple[Any, Any]) -> None:
    master.kill()
    nodes[0].expect("LOST")
    nodes[0].send(signal.SIGSTOP)  # or it may look before, and write after the value was set
    master.start()
    master.api.setParam("/test", "/server/depth/of/a", 7)
    nodes[0].send(signal.SIGCONT)
    nodes[0].expect("BACK")
    assert master.api.getParam("/test", "/server/depth/of")[2] == {"a": 7, "b": [1, 2.5]}


def test_a_master_that_was_away_for_a_moment_gets_all_again(master: Any, nodes: Tuple[Any, Any]) -> None:
    master.kill()
    master.start()
    for node in nodes:
        node.expect("was started anew")
    nodes[1].say("go")
    nodes[1].expect("ROUND")
    outsiders_are_served(master)


def descriptors(node: Any) -> List[str]:
    """The kinds of what a node has open."""
    found = []
    for name in os.listdir(f"/proc/{node.process.pid}/fd"):
        with contextlib.suppress(OSError):  # closed meanwhile
            found.append(os.readlink(f"/proc/{node.process.pid}/fd/{name}").split(":")[0])
    return sorted(found)


def test_a_loss_of_the_master_leaves_no_descriptor_open(master: Any, nodes: Tuple[Any, Any]) -> None:
    counts = []
    for _ in range(3):
        master.kill()
        master.start()
        for node in nodes:
            node.expect("was started anew")
        nodes[1].say("go")  # subscribes, and leaves the topics again
        nodes[1].expect("ROUND")
        counts.append([len(descriptors(node)) for node in nodes])
    end = time.monotonic() + LONG
    for node, count in zip(nodes, counts[0]):
        # The master has up to three connections to a node; those of before may be about to close, and so may
        # those of rospy's selectors, of which it has one for each topic that there ever was.
        while len(descriptors(node)) > count + 4 or descriptors(node).count("anon_inode") > 2:
            assert time.monotonic() < end, (counts, descriptors(node))
            time.sleep(0.05)


@pytest.mark.long
def test_nodes_go_on_at_a_master_that_hung(master: Any, nodes: Tuple[Any, Any]) -> None:
    master.process.send(signal.SIGSTOP)
    for node in nodes:
        node.expect("is silent, it is slow or hangs; what runs pauses")
    for node in nodes:
        node.expect("LOST", HUNG + 60.0)
    master.process.send(signal.SIGCONT)
    for node in nodes:
        node.expect("BACK")
    nodes[1].say("go")
    nodes[1].expect("ROUND")
    outsiders_are_served(master)
    assert master.api.getSystemState("/test")[2][0].count(["/count", ["/server"]]) == 1
    assert "/passing" not in str(master.api.getSystemState("/test"))


def test_nothing_is_lost_at_a_master_that_is_slow(master: Any, nodes: Tuple[Any, Any]) -> None:
    master.process.send(signal.SIGSTOP)
    for node in nodes:
        node.expect("is silent, it is slow or hangs; what runs pauses")
    nodes[1].say("go")  # what needs no master goes on, the rest waits for it
    master.process.send(signal.SIGCONT)
    for node in nodes:
        node.expect("answers again")
    nodes[1].expect("ROUND")
    for node in nodes:
        assert node.end() == 0
        assert "LOST" not in node.output


@pytest.mark.parametrize("fault", [signal.SIGKILL, signal.SIGSTOP])
def test_nodes_end_without_a_master(master: Any, nodes: Tuple[Any, Any], fault: int) -> None:
    master.process.send(fault)
    nodes[0].send(signal.SIGINT)  # at once
    nodes[1].expect("LOST" if fault == signal.SIGKILL else "is silent")
    nodes[1].send(signal.SIGINT)
    nodes[1].process.stdin.close()  # it would read on while the first one ends
    for node in nodes:
        assert node.ended() == 0
        assert "Traceback" not in node.output
        assert "by force" not in node.output


ASKING = """
import sys, time, rospy
from std_srvs.srv import Trigger
from merlin_ros.master.master_link import MasterSilent, get_param, set_param
from merlin_ros.node import run_node
from merlin_ros.service_proxy import ServiceError, ServiceProxy

def timed(call):
    begun = time.monotonic()
    try:
        answer = call()
    except (OSError, ServiceError) as error:
        answer = error
    return time.monotonic() - begun, answer

def start():
    rospy.set_param("~known", 7)
    get_param("~known")
    print("started", flush=True)
    def run():
        sys.stdin.readline()
        for call in (
            lambda: get_param("~known"),
            lambda: get_param("~unknown", 1),
            lambda: set_param("~known", 8),
            ServiceProxy("nowhere", Trigger).available,
            ServiceProxy("nowhere", Trigger),
            lambda: rospy.get_param("~known"),
            lambda: rospy.loginfo("a line of log"),
        ):
            took, answer = timed(call)
            print(f"ASKED {took:.1f} {type(answer).__name__} {answer}", flush=True)
    return run
sys.exit(run_node("asking", start))
"""


def test_no_call_waits_for_a_master_that_hangs(master: Any) -> None:
    node = master.node(ASKING)
    node.expect("started")
    master.process.send(signal.SIGSTOP)
    node.say("go")
    reported = [node.expect("ASKED").split(" ", 3) for _ in range(7)]
    assert all(float(took) < 2.5 + STALL for _, took, _, _ in reported), node.output
    assert [kind for _, _, kind, _ in reported] == [
        "int", "MasterSilent", "MasterSilent", "bool", "ServiceUnavailable", "MasterSilent", "NoneType"
    ]  # fmt: skip
    assert reported[0][3] == "7"
    assert f"cannot read the parameter /asking/unknown: {master.uri} did not answer" in reported[1][3]
    assert "service /nowhere does not answer: cannot look it up: " in reported[4][3]
    master.process.send(signal.SIGCONT)
    assert node.ended() == 0


# Keeps the nodes of others registered, and says when it has looked at them.
KEEPER = """
import sys
from merlin_ros.master.foreign_nodes import ForeignNodes
from merlin_ros.node import keep_foreign_nodes, run_node

look = ForeignNodes.look
def told(self, master):
    look(self, master)
    print("LOOKED", flush=True)
ForeignNodes.look = told

def start():
    keep_foreign_nodes()
    print("started", flush=True)
sys.exit(run_node("keeper", start))
"""
ROBOT = """<robot name="r"><link name="base"/><link name="laser"/>
<joint name="j" type="fixed"><parent link="base"/><child link="laser"/></joint></robot>"""


def test_nodes_of_others_are_found_at_a_master_that_was_started_anew(master: Any) -> None:
    master.api.setParam("/test", "/use_sim_time", False)
    master.api.setParam("/test", "/robot_description", ROBOT)
    publisher = master.spawn(node_path("robot_state_publisher", "robot_state_publisher"))
    ended = master.tool("rostopic", "pub", "/ended", "std_msgs/Int32", "5")
    for topic in ("/tf_static", "/ended"):
        echo = master.tool("rostopic", "echo", "-n", "1", topic)
        echo.expect("---")
        echo.ended()  # or it is taken for a node of others, too
    keeper = master.node(KEEPER)
    keeper.expect("started")
    keeper.expect("LOOKED")
    ended.process.kill()
    master.kill()
    keeper.expect("does not answer")
    master.start()
    assert "registered /robot_state_publisher" in keeper.expect("registered /")
    echo = master.tool("rostopic", "echo", "-n", "1", "/tf_static")
    echo.expect("laser")
    assert "/ended" not in str(master.api.getSystemState("/test"))
    assert publisher.process.poll() is None


# Everything here subscribes for the first time while the master is lost.
LATE = """
import sys, threading, time
from std_msgs.msg import Int32
from std_srvs.srv import Trigger
from merlin_executor.mission.readiness import missing_servers
from merlin_ros.deadline import Deadline, running_time
from merlin_ros.late_topics import subscribe_by
from merlin_ros.master import master_watch
from merlin_ros.node import on_master_lost, run_node
from merlin_ros.service_proxy import ServiceError, ServiceProxy
from merlin_sm.states.ros_calls import TopicState

lines = threading.Lock()  # print writes a line in parts, and two threads say something

def say(*words):
    with lines:
        print(*words, flush=True)

def start():
    master_watch.HUNG = 6.0
    on_master_lost(lambda: say("LOST"))
    state = TopicState("count", Int32, timeout=300.0)
    say("started")
    def run():
        sys.stdin.readline()
        say("TIME", running_time() > 0.0)
        say("STATE", state.execute({}), state.reason)
        say("SERVERS", missing_servers(["drive"], 0.1))
        begun = time.monotonic()
        try:
            ServiceProxy("ask", Trigger, patience=100.0)()
        except ServiceError as error:
            say("ASK", time.monotonic() - begun < 50.0, error)
        sys.stdin.readline()
        came = threading.Event()
        subscribe_by(Deadline(300.0), threading.Event(), "count", Int32, lambda _: came.set())
        say("HEARD", came.wait(300.0))
    return run
sys.exit(run_node("late", start))
"""


@pytest.mark.parametrize("fault", [signal.SIGKILL, signal.SIGSTOP])
def test_what_needs_a_topic_without_a_master_fails_and_names_it(master: Any, fault: int) -> None:
    master.api.setParam("/test", "/use_sim_time", False)
    node = master.node(LATE)
    node.expect("started")
    master.process.send(fault)
    node.say("go")
    node.expect("TIME True")
    reported = node.expect("STATE")
    assert f"cannot subscribe to /count: the master at {master.uri} does not answer" in reported
    assert "aborted" in reported
    assert "['drive']" in node.expect("SERVERS")
    assert "True service /ask does not answer: cannot look it up: the master" in node.expect("ASK")
    if fault == signal.SIGSTOP:
        master.process.send(signal.SIGCONT)
    else:
        master.start()
    server = master.node(SERVER)
    server.expect("started")
    node.say("go")
    assert "True" in node.expect("HEARD")
    assert node.ended() == 0

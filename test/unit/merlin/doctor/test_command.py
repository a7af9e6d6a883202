# SPDX-License-Identifier: Apache-2.0
"""`rosrun merlin doctor` over real nodes."""

import signal
import subprocess
from typing import Any, Dict

import pytest

from merlin.doctor import command, system
from merlin.doctor.findings import Machine
from merlin.launch_request import LaunchError
from merlin.running import NothingRuns
from merlin_ros.master.master_link import MasterSilent
from merlin_test import LONG
from merlin_test.node_path import node_path
from merlin_test.ports import free_ports, release

pytestmark = pytest.mark.processes

MOMENT = 1.3  # s for which a busy computer may stand still

#: A node of which the doctor has something to say, and one that was killed.
SICK = """
import rospy
from actionlib_msgs.msg import GoalStatusArray
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import TransformStamped, Twist
from move_base_msgs.msg import MoveBaseActionGoal
from tf2_msgs.msg import TFMessage
rospy.init_node("sick")
def send(topic, kind, message=None):
    publisher = rospy.Publisher(topic, kind, queue_size=1, latch=True)
    if message is not None:
        publisher.publish(message)
    return publisher
def frame(parent, child):
    each = TransformStamped(child_frame_id=child)
    each.header.frame_id, each.header.stamp = parent, rospy.Time.now() + rospy.Duration(100)
    return each
kept = [
    send("cmd_vel", Twist),
    rospy.Subscriber("cmd_vel", Twist),
    send("dock/status", GoalStatusArray),
    send("dance/goal", MoveBaseActionGoal),
    send("tf", TFMessage, TFMessage([frame("map", "odom"), frame("world", "camera")])),
    send("diagnostics", DiagnosticArray, DiagnosticArray(None, [DiagnosticStatus(2, "arm", "hot", "", [])])),
]
print("ready", flush=True)
rospy.spin()
"""
#: Each of two such nodes is a guard, serves the same action, gives the time, and moves the same frame.
GUARD = """
import sys
import rospy
from actionlib_msgs.msg import GoalStatusArray
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import TransformStamped, Twist
from merlin_msgs.msg import GuardStatus
from rosgraph_msgs.msg import Clock
from tf2_msgs.msg import TFMessage
rospy.init_node(sys.argv[1])
def send(topic, kind, message):
    publisher = rospy.Publisher(topic, kind, queue_size=1, latch=True)
    publisher.publish(message)
    return publisher
old = GoalStatusArray()
old.header.stamp = rospy.Time.now() - rospy.Duration(100)
arm = TransformStamped(child_frame_id="arm")
arm.header.frame_id, arm.header.stamp = sys.argv[1], rospy.Time.now()
kept = [
    rospy.Subscriber("cmd_vel_in", Twist),
    send("cmd_vel", Twist, Twist()),
    send("merlin/guard", GuardStatus, GuardStatus(warning="set base_timeout")),
    send("dock/status", GoalStatusArray, old),
    send("clock", Clock, Clock()),
    send("tf", TFMessage, TFMessage([arm])),
    send("diagnostics", DiagnosticArray, DiagnosticArray(None, [DiagnosticStatus(1, "leg", "old", "", [])])),
]
print("ready", flush=True)
rospy.spin()
"""
JOYSTICK = """
import rospy
from geometry_msgs.msg import Twist
rospy.init_node("joystick")
kept = rospy.Publisher("cmd_vel", Twist, queue_size=1)
print("ready", flush=True)
rospy.spin()
"""
DEAD = "import rospy; rospy.init_node('dead'); print('ready', flush=True); rospy.spin()"


def doctor(env: Dict[str, str]) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [node_path("merlin", "doctor")], env=env, capture_output=True, text=True, check=False, timeout=LONG
    )


def test_faults_of_nodes_are_reported(master: Any) -> None:
    master.node(SICK).expect("ready")
    dead = master.node(DEAD)
    dead.expect("ready")
    dead.end(signal.SIGKILL)
    done = doctor(master.env)
    assert done.returncode == 2 and not done.stderr, done
    for said in (
        "/dead does not answer",
        "no guard is between /sick and /cmd_vel",
        "/dock/status was silent",
        "/sick uses the action /dance, which nothing serves",
        "ahead of the clock here",
        "nothing connects map, world",
        "arm: hot",
    ):
        assert said in done.stdout


def test_what_is_there_twice_or_in_the_wrong_place_is_reported(master: Any) -> None:
    for started in (master.node(GUARD, "one"), master.node(GUARD, "two"), master.node(JOYSTICK)):
        started.expect("ready")
    done = doctor(master.env)
    assert done.returncode == 2 and not done.stderr, done
    for said in (
        "wrong: /one, /two all guard /cmd_vel",
        "wrong: /joystick publishes on /cmd_vel, past the guard",
        "wrong: no base listens to /cmd_vel of /one",
        "wrong: nothing sends on /cmd_vel_in, which the guard reads",
        "wrong: /one, /two all serve the action /dock",
        "wrong: /one publishes /clock, /use_sim_time is false",
        "wrong: /one, /two all publish /clock",
        "wrong: tf: arm has the parents one, two",
        "s behind the clock here",
        "note: /merlin/guard: set base_timeout",
        "note: leg: old",
    ):
        assert said in done.stdout


def test_simulated_time_without_a_clock_is_reported(master: Any) -> None:
    master.api.setParam("/test", "/use_sim_time", True)
    master.node(DEAD).expect("ready")
    done = doctor(master.env)
    assert done.returncode == 2 and not done.stderr, done
    assert "wrong: /use_sim_time is true and nothing publishes /clock" in done.stdout


def test_a_node_whose_address_is_none_is_reported(master: Any) -> None:
    uri = "http://127.0.0.1:11311:40001/"  # of ROS_IP with a port
    master.api.registerPublisher("/odd", "/chatter", "std_msgs/String", uri)
    done = doctor(master.env)
    assert done.returncode == 2 and not done.stderr, done
    assert f"wrong: /odd does not answer ({uri}" in done.stdout


def test_what_the_shell_sets_wrongly_is_reported(master: Any) -> None:
    master.kill()
    done = doctor({**master.env, "ROS_IP": "192.0.2.7", "ROS_HOME": "/proc/nowhere"})
    assert done.returncode == 2 and "Traceback" not in done.stderr, done  # rospack says of it, too
    assert "wrong: ROS_IP=192.0.2.7 is not an address of this computer" in done.stdout
    assert "wrong: /proc/nowhere cannot be written" in done.stdout


def choice(monkeypatch: pytest.MonkeyPatch, made: Any) -> None:
    """Which system is looked at, on a computer that is well."""

    def choose(*_: Any) -> Any:
        if isinstance(made, Exception):
            raise made
        return made

    monkeypatch.setattr(command, "choose", choose)
    monkeypatch.setattr(command, "look_at_machine", Machine)
    monkeypatch.setattr("sys.argv", ["doctor"])
    # Nothing listens there; on 11311 what is tested beside this may.
    monkeypatch.setenv("ROS_MASTER_URI", "http://localhost:1")


def test_of_several_systems_one_has_to_be_chosen(monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    choice(monkeypatch, LaunchError("several systems have nodes; choose one: …"))
    assert command.main() == 2
    assert "wrong: several systems have nodes; choose one: …\n1 wrong" in capsys.readouterr().out


def test_a_master_that_ends_meanwhile_is_reported(monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    (port,) = free_ports(1)
    choice(monkeypatch, (f"http://127.0.0.1:{port}", ["/base"]))
    try:
        assert command.main() == 2
    finally:
        release([port])
    assert f"wrong: the master at http://127.0.0.1:{port} answers no longer" in capsys.readouterr().out


def test_of_a_computer_that_is_well_nothing_is_wrong(monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    choice(monkeypatch, NothingRuns(""))
    assert command.main() == 0
    assert capsys.readouterr().out.endswith("looked at\nnothing is wrong\n")


def test_a_node_that_hangs_is_reported_and_holds_nothing_up(master: Any) -> None:
    hung = master.node(DEAD)
    hung.expect("ready")
    hung.send(signal.SIGSTOP)
    assert "wrong: /dead does not answer" in doctor(master.env).stdout


class StoodStill:
    """Stands for a master with one node, whose computer stands still for a moment while the node is asked."""

    master_uri = "http://localhost:11311"
    getSystemState = staticmethod(lambda: ([["/chatter", ["/camera"]]], [], []))
    getTopicTypes = staticmethod(list)
    getParamNames = staticmethod(list)
    hasParam = staticmethod(lambda name: False)
    lookupNode = staticmethod(lambda name: "http://localhost:7")

    def __init__(self, _uri: str = "", limit: float = 0.0) -> None:
        self._limit = limit

    def getPid(self, caller: str) -> int:
        if self._limit < MOMENT:
            raise MasterSilent("no answer")
        return 1


def test_a_node_that_stood_still_for_a_moment_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(system, "bounded_master", lambda *_: StoodStill())
    monkeypatch.setattr(system, "bounded_proxy", StoodStill)
    graph = system.look_at_graph()
    assert graph.publishers == {"/chatter": ["/camera"]} and not graph.silent


def test_without_a_master_the_computer_is_looked_at(master: Any) -> None:
    master.kill()
    done = doctor(master.env)
    assert "note: nothing runs: only the computer was looked at" in done.stdout and not done.stderr


def test_a_master_elsewhere_that_is_not_reached_is_wrong(master: Any) -> None:
    done = doctor({**master.env, "ROS_MASTER_URI": "http://no-such-host.invalid:11311"})
    assert done.returncode == 2 and not done.stderr
    assert "wrong: the master at http://no-such-host.invalid:11311 cannot be reached" in done.stdout


@pytest.mark.parametrize("uri", ["nonsense", "http://", "http://localhost:port"])
def test_an_address_that_is_none_is_one_sentence(uri: str, master: Any) -> None:
    done = doctor({**master.env, "ROS_MASTER_URI": uri})
    assert done.returncode == 2 and not done.stderr
    assert "wrong: ROS_MASTER_URI is not http://host:port; correct it" in done.stdout


def test_a_master_that_hangs_is_wrong(master: Any) -> None:
    master.process.send(signal.SIGSTOP)
    done = doctor(master.env)
    assert done.returncode == 2 and "takes connections" in done.stdout and not done.stderr

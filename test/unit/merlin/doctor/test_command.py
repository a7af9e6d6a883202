# SPDX-License-Identifier: Apache-2.0
"""`rosrun merlin doctor` over real nodes."""

import signal
import subprocess
from typing import Any, Dict

import pytest

pytestmark = pytest.mark.processes

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
DEAD = "import rospy; rospy.init_node('dead'); print('ready', flush=True); rospy.spin()"


def doctor(env: Dict[str, str]) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        ["rosrun", "merlin", "doctor"], env=env, capture_output=True, text=True, check=False, timeout=120
    )


def test_faults_of_nodes_are_told(master: Any) -> None:
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


def test_a_node_that_hangs_is_told_and_holds_nothing_up(master: Any) -> None:
    hung = master.node(DEAD)
    hung.expect("ready")
    hung.send(signal.SIGSTOP)
    assert "wrong: /dead does not answer" in doctor(master.env).stdout


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

# SPDX-License-Identifier: Apache-2.0
"""A node begins although its master is slow at that moment."""

import contextlib
import signal
import sys
from typing import Any

import pytest

pytestmark = pytest.mark.processes

MASTER = """
import signal, sys, threading
import rosmaster.master_api
from merlin.master import Master

call, name, late = sys.argv[1:]
answer, asked = getattr(rosmaster.master_api.ROSMasterHandler, call), set()

def answer_late(handler, caller, *what):
    if what[0] == name and caller not in asked:
        asked.add(caller)
        print("asked", flush=True)
        threading.Event().wait(float(late))
    return answer(handler, caller, *what)

setattr(rosmaster.master_api.ROSMasterHandler, call, answer_late)
print(Master().port, flush=True)
signal.pause()
"""
NODE = """
import sys, rospy
from std_msgs.msg import Empty
from merlin_ros.master.master_link import bounded_master, get_param
from merlin_ros.node import run_node

def start():
    rospy.Publisher("/mine", Empty, queue_size=1)
    rospy.get_param("/an/other", 0)
    get_param("/a/value", 0)
    bounded_master().lookupNode("/patient")
    print("begun at", rospy.get_time() > 0, flush=True)

sys.exit(run_node("patient", start))
"""


@pytest.mark.parametrize(
    ("call", "name"),
    [
        ("getParam", "/use_sim_time"),
        ("registerPublisher", "/mine"),
        ("getParam", "/an/other"),
        ("getParam", "/a/value"),
        ("lookupNode", "/patient"),
    ],
)
def test_a_master_that_answers_late_is_waited_for(master: Any, call: str, name: str) -> None:
    slow = master.spawn(sys.executable, "-c", MASTER, call, name, "4.0")
    master.env["ROS_MASTER_URI"] = f"http://localhost:{slow.expect('')}"
    node = master.node(NODE)
    slow.expect("asked")
    node.expect("begun at True")
    assert node.end() == 0
    with contextlib.suppress(OSError):
        slow.end()


@pytest.mark.parametrize("name", ["/an/other", "/a/value"])
def test_a_node_that_is_ended_while_it_waits_for_its_master_ends_in_order(master: Any, name: str) -> None:
    slow = master.spawn(sys.executable, "-c", MASTER, "getParam", name, "600.0")
    master.env["ROS_MASTER_URI"] = f"http://localhost:{slow.expect('')}"
    node = master.node(NODE)
    slow.expect("asked")
    assert node.end(signal.SIGTERM) == 143
    assert "by force" not in node.output and "Traceback" not in node.output
    slow.send(signal.SIGKILL)

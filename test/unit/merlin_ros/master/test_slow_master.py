# SPDX-License-Identifier: Apache-2.0
"""A node begins although its master is slow at that moment."""

import contextlib
import sys
from typing import Any

import pytest

pytestmark = pytest.mark.processes

MASTER = """
import signal, threading
import rosmaster.master_api
from merlin.master import Master

get, asked = rosmaster.master_api.ROSMasterHandler.getParam, set()

def get_late(handler, caller, name):
    if name == "/use_sim_time" and caller not in asked:
        asked.add(caller)
        print("asked", flush=True)
        threading.Event().wait(4.0)
    return get(handler, caller, name)

rosmaster.master_api.ROSMasterHandler.getParam = get_late
print(Master().port, flush=True)
signal.pause()
"""
NODE = """
import rospy
from merlin_ros.node import init_node
init_node("patient")
print("begun at", rospy.get_time() > 0, flush=True)
"""


def test_a_master_that_answers_late_is_waited_for(master: Any) -> None:
    slow = master.spawn(sys.executable, "-c", MASTER)
    master.env["ROS_MASTER_URI"] = f"http://localhost:{slow.expect('')}"
    node = master.node(NODE)
    slow.expect("asked")
    node.expect("begun at True")
    assert node.ended() == 0
    with contextlib.suppress(OSError):
        slow.end()

# SPDX-License-Identifier: Apache-2.0
"""An action client finds a server although the master's word of it was lost, and says where there is none."""

from typing import Any

import pytest

pytestmark = pytest.mark.processes

CLIENT = """
import rospy
from rospy.impl.masterslave import ROSHandler
from merlin_msgs.msg import ListenAction
from merlin_ros.actions.action_client import ActionClient
from merlin_ros.node import init_node

lost, heard = [], ROSHandler.publisherUpdate

def lose_first(handler, caller, topic, publishers):
    if topic in lost or "/speech/" not in topic:
        return heard(handler, caller, topic, publishers)
    lost.append(topic)
    return 1, "", 0

ROSHandler.publisherUpdate = lose_first
init_node("client")
client = ActionClient("speech", ListenAction)
while client.missing != "no node publishes its status":
    client.wait_for_server(2.0)
print(client.absence(2.0), flush=True)
print("there", client.wait_for_server(300.0), sorted(lost), flush=True)
"""
SERVER = """
import rospy
from merlin_msgs.msg import ListenAction
from merlin_ros.actions.serial_action_server import SerialActionServer
from merlin_ros.node import init_node

init_node("server")
SerialActionServer("speech", ListenAction, lambda goal: goal.succeed()).start()
rospy.spin()
"""


def test_a_server_is_found_although_the_word_of_it_was_lost(master: Any) -> None:
    client = master.node(CLIENT)
    client.expect("no action server /speech within 2 s (no node publishes its status)")
    master.node(SERVER)
    client.expect("there True ['/speech/feedback', '/speech/result', '/speech/status']")
    assert client.ended() == 0

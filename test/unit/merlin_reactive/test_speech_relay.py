# SPDX-License-Identifier: Apache-2.0
"""The action sound_play over a robot's own speech: an action of another server, or a topic."""

import re

import pytest

from merlin_reactive.speech.speech_relay import Form
from merlin_ros.parameters import ParameterError

pytestmark = pytest.mark.processes

RELAY = "from merlin_reactive.speech.speech_relay import main; raise SystemExit(main())"
#: Another server, plain actionlib: it says the text of `sound_request.arg2`, or speaks until it is cancelled.
SERVER = """
import actionlib, rospy, sys, threading
from sound_play.msg import SoundRequestAction, SoundRequestResult
rospy.init_node("tts")
def accept(handle):
    handle.set_accepted()
    print("says", handle.get_goal().sound_request.arg2, handle.get_goal().sound_request.volume, flush=True)
    if handle.get_goal().sound_request.arg2 == "hello":
        handle.set_succeeded(SoundRequestResult())
def cancel(handle):
    handle.set_canceled(SoundRequestResult())
    print("stopped", flush=True)
server = actionlib.ActionServer("tts", SoundRequestAction, accept, cancel, auto_start=False)
server.start()
print("ready", flush=True)
rospy.spin()
"""
CLIENT = """
import rospy, sys
from merlin_ros.actions.action_client import ActionClient
from sound_play.msg import SoundRequest, SoundRequestAction, SoundRequestGoal
rospy.init_node("client")
client = ActionClient("sound_play", SoundRequestAction)
assert client.wait_for_server(300.0)
request = SoundRequest(sound=int(sys.argv[2]), command=1, arg=sys.argv[1], volume=1.0)
goal = client.send(SoundRequestGoal(sound_request=request))
if "later" in sys.argv[1]:
    sys.stdin.readline()
    goal.cancel()
goal.wait()
print("status", goal.status, goal.text, flush=True)
"""
SAY, BEEP = "-3", "1"
LISTENER = """
import rospy
from merlin_test.topic_links import wait_for_publishers
from std_msgs.msg import String
rospy.init_node("robot")
heard = rospy.Subscriber("speech", String, lambda message: print("says", message.data, flush=True))
wait_for_publishers(heard)
print("ready", flush=True)
rospy.spin()
"""
TO_ACTION = ["_to:=tts", "_type:=sound_play/SoundRequestAction", "_field:=sound_request.arg2"]


def relay(master, *arguments):
    return master.node(RELAY, *arguments)


def test_an_action_of_another_server_says_it(master):
    server = master.node(SERVER)
    server.expect("ready")
    relay(master, *TO_ACTION, "_fields:={sound_request.volume: 0.5}")
    client = master.node(CLIENT, "hello", SAY)
    assert server.expect("says") == "says hello 0.5"
    assert client.expect("status").startswith("status 3")
    assert "makes no sounds" in master.node(CLIENT, "", BEEP).expect("status 4")


def test_a_cancel_reaches_the_other_server(master):
    server = master.node(SERVER)
    server.expect("ready")
    relay(master, *TO_ACTION)
    client = master.node(CLIENT, "later", SAY)
    server.expect("says later")
    client.process.stdin.write("\n")
    client.process.stdin.flush()
    server.expect("stopped")
    assert client.expect("status").startswith("status 2")


def test_a_topic_says_it(master):
    relay(master, "_words_per_minute:=6000")
    assert "nothing listens to /speech" in master.node(CLIENT, "hello", SAY).expect("status 4")
    listener = master.node(LISTENER)
    listener.expect("ready")
    assert master.node(CLIENT, "good morning", SAY).expect("status").startswith("status 3")
    assert listener.expect("says") == "says good morning"


@pytest.mark.parametrize(
    ("kind", "field", "fields", "said"),
    [
        ("no_msgs/Voice", "data", {}, "'no_msgs/Voice', which no sourced workspace has"),
        ("nonsense", "data", {}, "'nonsense', which no sourced workspace has"),
        ("std_msgs/String", "text", {}, "do not fit std_msgs/String"),
        ("std_msgs/String", "data", {"data.x": 1}, "do not fit std_msgs/String"),
        ("std_msgs/Int32", "data", {}, "do not fit std_msgs/Int32"),
    ],
)
def test_a_form_that_cannot_be_filled_is_refused(kind, field, fields, said):
    with pytest.raises(ParameterError, match=re.escape(said)):
        Form(kind, field, fields)


def test_what_cannot_be_ends_with_2(master):
    node = relay(master, "_fields:=[1]")
    assert node.expect("~field or ~fields do not fit std_msgs/String")
    assert node.ended() == 2

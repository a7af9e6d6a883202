# SPDX-License-Identifier: Apache-2.0
"""An action server whose code ends goals with what cannot be sent: each client gets its answer."""

from typing import Any

# Ends each goal as the frame of its target says.
SERVER = """
import sys
from geometry_msgs.msg import PoseStamped
from move_base_msgs.msg import MoveBaseAction, MoveBaseResult
from merlin_msgs.msg import ListenAction, ListenResult
from merlin_ros.actions.serial_action_server import SerialActionServer
from merlin_ros.node import run_node

def execute(goal):
    wanted = goal.goal.grammar
    if wanted == "raise":
        raise ValueError("caf\\udce9")
    if wanted == "text":
        goal.abort(ListenResult(), "caf\\udce9")
    if wanted == "result":
        goal.succeed(ListenResult(text=3))
    if wanted == "number":
        goal.succeed(ListenResult(confidence=1e300))
    if wanted == "error":
        goal.abort(ListenResult(), ValueError("an error is not text"))
    goal.succeed(ListenResult(text="good"))

def start():
    start.server = SerialActionServer("listen", ListenAction, execute)
    start.server.start()
    print("started", flush=True)
sys.exit(run_node("server", start))
"""

CLIENT = """
import sys
from merlin_msgs.msg import ListenAction, ListenGoal
from merlin_ros.actions.action_client import ActionClient
from merlin_ros.node import run_node

def start():
    client = ActionClient("listen", ListenAction)
    assert client.wait_for_server(300.0)
    def run():
        for wanted in ("raise", "text", "result", "number", "error", "good"):
            goal = client.send(ListenGoal(grammar=wanted))
            assert goal.wait(300.0), wanted
            print("ANSWER", wanted, goal.status, goal.text, goal.result and goal.result.text, flush=True)
    return run
sys.exit(run_node("client", start))
"""


def test_every_goal_is_answered_and_the_server_lives_on(master: Any) -> None:
    server = master.node(SERVER)
    server.expect("started")
    client = master.node(CLIENT)
    assert client.expect("ANSWER raise").startswith("ANSWER raise 4 ValueError: caf?")
    assert client.expect("ANSWER text").startswith("ANSWER text 4 caf?")
    assert client.expect("ANSWER result").startswith("ANSWER result 4 the result cannot be sent: ")
    assert client.expect("ANSWER number").startswith("ANSWER number 4 the result cannot be sent: ")
    assert client.expect("ANSWER error").startswith("ANSWER error 4 an error is not text")
    assert client.expect("ANSWER good") == "ANSWER good 3  good"

# SPDX-License-Identifier: Apache-2.0
"""What an action server publishes: its status, in virtual time, and an answer to each goal."""

from types import SimpleNamespace
from typing import Any, Callable, Iterator, List, Tuple

import pytest
from actionlib_msgs.msg import GoalID
from fakes.topics import Topics
from move_base_msgs.msg import MoveBaseAction, MoveBaseActionGoal

from merlin_ros.actions import action_server
from merlin_ros.actions.action_server import ActionServer, ServerGoal

SECOND = 5  # beats, as actionlib has them
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


class Served:
    """The server of an action ``drive``; its goals run until they are ended."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.topics = Topics(monkeypatch)
        self.goals: List[ServerGoal] = []
        self._now = 1000.0
        self._beats: List[Tuple[float, Callable[[], object]]] = []
        monkeypatch.setattr(action_server, "time", SimpleNamespace(monotonic=lambda: self._now))
        monkeypatch.setattr(action_server, "every", self._every)
        later = SimpleNamespace(waits=True, cancel=lambda: None)  # of a burst: time stands meanwhile
        monkeypatch.setattr(action_server, "call_later", lambda seconds, call: later)
        self.server = ActionServer("drive", MoveBaseAction, self.goals.append, lambda goal: None)
        self.server.start()

    def _every(self, period: float, call: Callable[[], object]) -> SimpleNamespace:
        self._beats.append((period, call))
        return SimpleNamespace(cancel=lambda: None)

    def send(self) -> ServerGoal:
        """A client sends a goal, which is accepted."""
        self.topics.send("/drive/goal", MoveBaseActionGoal(goal_id=GoalID(id="a")))
        self.goals[-1].accept()
        return self.goals[-1]

    def statuses(self, seconds: float) -> int:
        """How many lists come in so many s."""
        published = self.topics.published("/drive/status")
        while not published.empty():
            published.get()
        ((period, beat),) = self._beats
        for _ in range(round(seconds / period)):
            self._now += period
            beat()
        return published.qsize()


@pytest.fixture
def served(monkeypatch: pytest.MonkeyPatch, clock: Any) -> Iterator[Served]:
    made = Served(monkeypatch)
    yield made
    made.server.shutdown()


def test_a_server_without_a_goal_speaks_less_often(served: Served) -> None:
    served.statuses(10.0)
    # What the guard takes for silence, a second, has two statuses and more.
    assert 2 * 10 < served.statuses(10.0) < 10 * SECOND


def test_each_beat_has_a_status_while_a_goal_is_open_and_behind_its_end(served: Served) -> None:
    served.statuses(10.0)
    goal = served.send()
    assert served.statuses(10.0) == 10 * SECOND
    goal.succeed()
    assert served.statuses(1.0) == SECOND
    served.statuses(10.0)
    assert served.statuses(10.0) < 10 * SECOND


@pytest.mark.parametrize("topic", ["status", "result"])
def test_a_client_that_connects_hears_it_in_each_period(served: Served, topic: str) -> None:
    served.statuses(10.0)
    served.topics.subscribe(f"/drive/{topic}")
    assert served.statuses(1.0) == SECOND


def test_a_goal_that_ends_with_what_cannot_be_sent_is_answered_and_the_server_lives_on(master: Any) -> None:
    server = master.node(SERVER)
    server.expect("started")
    client = master.node(CLIENT)
    assert client.expect("ANSWER raise").startswith("ANSWER raise 4 ValueError: caf?")
    assert client.expect("ANSWER text").startswith("ANSWER text 4 caf?")
    assert client.expect("ANSWER result").startswith("ANSWER result 4 the result cannot be sent: ")
    assert client.expect("ANSWER number").startswith("ANSWER number 4 the result cannot be sent: ")
    assert client.expect("ANSWER error").startswith("ANSWER error 4 an error is not text")
    assert client.expect("ANSWER good") == "ANSWER good 3  good"

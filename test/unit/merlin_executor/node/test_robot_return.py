# SPDX-License-Identifier: Apache-2.0
"""Without a plan, a robot whose host is gone is waited for; one that cannot be back soon is not."""

from typing import Any, Sequence

import pytest

pytestmark = pytest.mark.processes

#: Of the robots ria, ann and tom, ann is out and tom is there. Its input: ``wait``, ``cancel``, ``run`` for
#: the next run, or a robot and the state of its host.
EXECUTOR = """
import sys, threading
from types import SimpleNamespace
import rospy
from merlin_msgs.msg import RobotHost
from merlin_executor.node.robot_return import RobotReturn
from merlin_planning.knowledge_client import fact
from merlin_ros.node import init_node

init_node("executor")
known, connected, cancels, waited_for = {"tom"}, threading.Event(), [], set()

class Connected(rospy.SubscribeListener):
    def peer_subscribe(self, *_):
        connected.set()

publisher = rospy.Publisher("/kb/robots", RobotHost, Connected(), queue_size=10)
counted = SimpleNamespace(typed_parameters=["r"])
robots = RobotReturn(SimpleNamespace(
    name="/kb",
    predicates=lambda: {"available": counted} if "available" in sys.argv else {},
    propositions=lambda name: [fact(name, robot) for robot in known],
    query=lambda items: [item.values[0].value in known for item in items],
), ["ria", "ann", "tom"] if "one" not in sys.argv else [], float(sys.argv[1]))

def interruptible(cancel):
    if cancel:
        cancels.append(cancel)
        print("it waits", flush=True)

def wait():
    print("back:", robots.wait(interruptible, waited_for), flush=True)

for line in sys.stdin:
    if line == "wait\\n":
        threading.Thread(target=wait, name="wait", daemon=True).start()
    elif line == "run\\n":
        waited_for.clear()
    elif line == "cancel\\n":
        cancels.pop()()
    else:
        robot, state = line.split()
        {"available": known.add, "gone": known.discard}.get(state, lambda robot: None)(robot)
        if state != "gone":
            connected.wait()
            publisher.publish(RobotHost(robot="ann", out="is out"))
            publisher.publish(RobotHost(robot=robot, out="is out" if state == "out" else ""))
"""


def test_a_robot_that_comes_back_is_used_and_waited_for_once_in_a_run(master: Any) -> None:
    executor = master.node(EXECUTOR, "600", "available")
    executor.say("wait")
    executor.expect("no plan without ria, ann; waits 600 s at most")
    executor.expect("it waits")
    executor.say("ria heard")  # the knowledge does not say so yet
    executor.say("ria available")
    executor.expect("back: True")
    executor.say("ria gone")
    executor.say("wait")
    executor.expect("back: False")
    executor.say("run")
    executor.say("wait")
    executor.expect("it waits")
    executor.say("cancel")
    executor.expect("back: False")


def test_a_robot_that_was_taken_out_is_not_waited_for(master: Any) -> None:
    executor = master.node(EXECUTOR, "600", "available")
    executor.say("wait")
    executor.expect("it waits")
    executor.say("ria out")
    executor.expect("back: False")


def test_what_did_not_come_is_waited_for_again_when_it_has_been_back(master: Any) -> None:
    executor = master.node(EXECUTOR, "0.2", "available")
    executor.say("wait")
    executor.expect("no plan without ria, ann; waits 0.2 s at most")
    executor.expect("back: False")
    for state in ("lost", "available", "gone"):
        executor.say("run")
        executor.say(f"ria {state}")
        executor.say("wait")
        executor.expect("back: False")
    assert executor.output.count("it waits") == 2


@pytest.mark.parametrize("words", [(), ("available", "one")], ids=["no such fact", "another's fact"])
def test_only_what_the_bridges_say_of_robots_counts(master: Any, words: Sequence[str]) -> None:
    executor = master.node(EXECUTOR, "600", *words)
    executor.say("wait")
    executor.expect("back: False")
    assert "it waits" not in executor.output

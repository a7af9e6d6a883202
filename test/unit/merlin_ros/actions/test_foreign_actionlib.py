# SPDX-License-Identifier: Apache-2.0
"""Plain servers of actionlib: a clock that is set back, a link that sends late, a plain client as well."""

import sys
from typing import Any

import pytest

from merlin_test.node_path import LEAN

SERVER = """
import actionlib, rospy
from merlin_msgs.msg import ListenAction, ListenResult

rospy.init_node("server")
rospy.set_param("listen/status_list_timeout", 300.0)  # s for which the second process finds the stamp
server = actionlib.SimpleActionServer(
    "listen", ListenAction, lambda goal: server.set_succeeded(ListenResult(text="heard")), auto_start=False
)
server.start()
print("serves", flush=True)
rospy.spin()
"""

CLIENT = """
import sys, time
import rospy
from merlin_msgs.msg import ListenAction, ListenGoal
from merlin_ros.actions.action_client import ActionClient

wall, back = time.time, [float(sys.argv[1])]
time.time = lambda: wall() - back[0]
rospy.init_node("client")
if sys.argv[2:] == ["smach"]:
    import smach, smach_ros
    state = smach_ros.SimpleActionState("listen", ListenAction, goal=ListenGoal())
    run = lambda: state.execute(smach.UserData())
else:
    client = ActionClient("listen", ListenAction)
    assert client.wait_for_server(300.0)
    def run():
        goal = client.send(ListenGoal())
        assert goal.wait(300.0)
        return goal.status, goal.result.text
print("END", run(), flush=True)
back[0] += 86400.0
print("END", run(), flush=True)
"""

# It has greeted the subscriber of its results when a status goes out, and sends to it only when the next one
# does: between both, rospy starts a thread and logs.
LATE = """
import threading
import actionlib, rospy
from rospy.topics import _PublisherImpl
from merlin_msgs.msg import ListenAction, ListenResult

late = []  # calls that add the link for results
add = _PublisherImpl.add_connection
def add_late(publisher, connection):
    if publisher.resolved_name == "/listen/result":
        late.append(lambda: add(publisher, connection))
    else:
        add(publisher, connection)
_PublisherImpl.add_connection = add_late

class Statuses:
    said = 0
    def publish(self, message):
        links = (status, server.action_server.goal_sub, server.action_server.cancel_sub)
        if not message.status_list:  # no goal has come
            if not late or not all(link.get_num_connections() for link in links):
                return
            self.said += 1
            if self.said == 2:
                late[0]()
        status.publish(message)

rospy.init_node("server")
server = actionlib.SimpleActionServer(
    "listen", ListenAction, lambda goal: server.set_succeeded(ListenResult(text="heard")), auto_start=False
)
server.start()
status, server.action_server.status_pub = server.action_server.status_pub, Statuses()
status.impl.latch = None
print("serves", flush=True)
rospy.spin()
"""

BOTH = """
import sys
import actionlib, rospy
from merlin_msgs.msg import ListenAction, ListenGoal, ListenResult
from merlin_ros.actions.action_client import ActionClient

rospy.init_node("both")
begun = []
def execute(goal):
    begun.append(goal)
    while not server.is_preempt_requested() and not rospy.is_shutdown() and not sys.stdin.readline():
        pass
    if server.is_preempt_requested():
        server.set_preempted()
    else:
        server.set_succeeded(ListenResult(text="heard"))
server = actionlib.SimpleActionServer("listen", ListenAction, execute, auto_start=False)
server.start()
ours = ActionClient("listen", ListenAction)
assert ours.wait_for_server(300.0)
plain = actionlib.SimpleActionClient("listen", ListenAction)
assert plain.wait_for_server(rospy.Duration(300.0))
heard = []
plain.send_goal(ListenGoal(), active_cb=lambda: heard.append(1))
statuses = []
subscriber = rospy.Subscriber("listen/status", rospy.AnyMsg, statuses.append)
while len(statuses) < 5:
    rospy.sleep(0.05)
print("go on", flush=True)
assert plain.wait_for_result(rospy.Duration(300.0))
print("END", plain.get_state(), plain.get_result().text, flush=True)
"""

AHEAD = """
import sys, time
import rospy
from merlin_msgs.msg import ListenAction, ListenGoal
from merlin_ros.actions.action_client import ActionClient

wall, back = time.time, [0.0]
time.time = lambda: wall() - back[0]
rospy.init_node("client")
client = ActionClient("listen", ListenAction)
for _ in range(2):
    assert client.wait_for_server(300.0)
    goal = client.send(ListenGoal())
    print("AHEAD", goal.goal_id.stamp.to_sec() > time.time() + 1.0, flush=True)
    assert goal.wait(300.0)
    back[0] = 86400.0
    sys.stdin.readline()
"""

pytestmark = pytest.mark.processes


def run(master: Any, code: str, *arguments: str) -> Any:
    return master.spawn(sys.executable, "-c", LEAN + code, *arguments)


@pytest.mark.parametrize(("kind", "end"), [("merlin", "END (3, 'heard')"), ("smach", "END succeeded")])
def test_a_clock_that_is_set_back_refuses_no_goal(master: Any, kind: str, end: str) -> None:
    run(master, SERVER).expect("serves")
    options = [kind] if kind == "smach" else []
    client = run(master, CLIENT, "0", *options)
    assert [client.expect("END"), client.expect("END")] == [end, end]
    client.ended()
    again = run(master, CLIENT, "86400", *options)  # its process begins after the step
    assert [again.expect("END"), again.expect("END")] == [end, end]


def test_a_server_that_was_restarted_takes_goals_with_the_stamps_of_a_clock_that_was_set_back(
    master: Any,
) -> None:
    """A stamp of before would have it refuse the goals of all other clients until the clock has caught up."""
    server, client = run(master, SERVER), run(master, AHEAD)
    assert client.expect("AHEAD") == "AHEAD False"
    server.end()
    run(master, SERVER).expect("serves")
    client.say("go on")
    assert client.expect("AHEAD") == "AHEAD False"


@pytest.mark.parametrize(("kind", "end"), [("merlin", "END (3, 'heard')"), ("smach", "END succeeded")])
def test_a_result_is_not_lost_before_the_server_sends_over_its_link(master: Any, kind: str, end: str) -> None:
    run(master, LATE).expect("serves")
    options = [kind] if kind == "smach" else []
    assert run(master, CLIENT, "0", *options).expect("END") == end


def test_the_goal_of_a_plain_client_beside_one_of_merlin_is_left_alone(master: Any) -> None:
    node = run(master, BOTH)
    node.expect("go on")
    node.process.stdin.write("heard\n")
    node.process.stdin.flush()
    assert node.expect("END") == "END 3 heard"

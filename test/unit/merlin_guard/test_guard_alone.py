# SPDX-License-Identifier: Apache-2.0
"""The guard where nothing else of MERLIN is installed, as a process: it passes, holds, and ends."""

import os
import signal
from typing import Any

import pytest

from merlin_guard.guard_node import PRIORITY
from merlin_test.priorities import may_go_before_others

pytestmark = pytest.mark.processes

GUARD = """
import sys

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] == "merlin_sm":
            raise ImportError(f"{name} is not installed")

sys.meta_path.insert(0, Missing())
from merlin_guard.guard_node import main
sys.exit(main())
"""

# A guard that waits for a line before it looks for other guards.
LOOKS = """
import sys
from merlin_guard import guard_node
from merlin_guard.surroundings import RosGraph

look = RosGraph.other_guards

def other_guards(graph, topic):
    print("LOOKS", flush=True)
    sys.stdin.readline()
    return look(graph, topic)

RosGraph.other_guards = other_guards
sys.exit(guard_node.main())
"""

# A guard that prints when it publishes a stop, and when the master has it.
ORDER = """
import sys, rospy
from merlin_msgs.msg import GuardStatus
from merlin_guard import guard_node
from merlin_ros.master.master_link import known_params

guard_node.REMEMBER = 60.0
publish, set_param = rospy.Publisher.publish, guard_node.set_param

def tell(publisher, *message):
    if message and getattr(message[0], "state", None) == GuardStatus.STOPPED:
        print("TOLD", flush=True)
    publish(publisher, *message)

def keep(name, value):
    set_param(name, value)
    if name == guard_node.STOPPED_PARAM:
        print("KEPT", known_params()["/merlin_guard/stopped"], flush=True)  # so a new master gets it, too

rospy.Publisher.publish, guard_node.set_param = tell, keep
sys.exit(guard_node.main())
"""

# A guard whose log hangs, as the disk or the terminal below it may.
DUMB = """
import io, sys, threading
from merlin_guard.guard_node import main

class Hung(io.StringIO):
    def write(self, text):
        print("HANGS", flush=True)
        threading.Event().wait()

sys.stderr = Hung()
sys.exit(main())
"""

# A motion server and its controller: drives while a line says so.
DRIVER = """
import sys, threading, rospy
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray
from geometry_msgs.msg import Twist
from merlin_test.topic_links import init_node

init_node("driver")
active = threading.Event()
moved = []

def receive(velocity):
    moves = velocity.linear.x > 0
    if moved[-1:] != [moves]:
        moved.append(moves)
        print("MOVES" if moves else "STANDS", flush=True)

rospy.Subscriber("cmd_vel", Twist, receive)
status = rospy.Publisher("move_base/status", GoalStatusArray, queue_size=1)
velocity = rospy.Publisher("cmd_vel_in", Twist, queue_size=1)

def drive():
    while not rospy.is_shutdown():
        state = GoalStatus.ACTIVE if active.is_set() else GoalStatus.SUCCEEDED
        status.publish(GoalStatusArray(status_list=[GoalStatus(GoalID(id="by hand"), state, "")]))
        command = Twist()
        command.linear.x = 0.3
        velocity.publish(command)
        rospy.rostime.wallsleep(0.05)

threading.Thread(target=drive, daemon=True).start()
print("started", flush=True)
for line in sys.stdin:
    active.set() if line.strip() == "drive" else active.clear()
"""

# A simulator of another kind at a tenth of real time, and a plain motion server in it: its status
# comes five times per second of the simulation. It prints whether the base goes on through three of them.
SLOW = """
import rospy
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray
from geometry_msgs.msg import Twist
from rosgraph_msgs.msg import Clock
from merlin_test.topic_links import init_node

init_node("slow")
moved = []

def receive(velocity):
    moves = velocity.linear.x > 0
    if moved[-1:] != [moves]:
        moved.append(moves)

rospy.Subscriber("cmd_vel", Twist, receive)
clock = rospy.Publisher("/clock", Clock, queue_size=1)
status = rospy.Publisher("move_base/status", GoalStatusArray, queue_size=1)
velocity = rospy.Publisher("cmd_vel_in", Twist, queue_size=1)
active = GoalStatusArray(status_list=[GoalStatus(GoalID(id="by hand"), GoalStatus.ACTIVE, "")])
command = Twist()
command.linear.x = 0.3
steps = 0

def step():
    global steps
    steps += 1
    clock.publish(rospy.Time.from_sec(100.0 + 0.005 * steps))
    velocity.publish(command)
    rospy.rostime.wallsleep(0.05)

while True not in moved:
    status.publish(active)
    step()
for number in range(120):
    if number % 40 == 0:
        status.publish(active)
    step()
print("MOVED", moved[moved.index(True):] == [True], flush=True)
"""

# A joystick with as many buttons as a line says, all of them pressed. It prints what the guard warns of.
JOYSTICK = """
import sys, threading, rospy
from merlin_msgs.msg import GuardStatus
from sensor_msgs.msg import Joy
from merlin_test.topic_links import init_node

init_node("joystick")
warned = [""]

def receive(status):
    if status.warning != warned[-1] or status.state == GuardStatus.STOPPED:
        warned.append(status.warning)
        print("GUARD", status.state == GuardStatus.STOPPED, status.reason, status.warning, flush=True)

rospy.Subscriber("merlin/guard", GuardStatus, receive)
joy = rospy.Publisher("joy", Joy, queue_size=1)
buttons = []

def press():
    while not rospy.is_shutdown():
        if buttons:
            joy.publish(Joy(buttons=buttons))
        rospy.rostime.wallsleep(0.05)

threading.Thread(target=press, daemon=True).start()
print("started", flush=True)
for line in sys.stdin:
    buttons = [1] * int(line)
"""

STOPPER = """
import rospy
from std_srvs.srv import Trigger

rospy.init_node("stopper")
rospy.wait_for_service("merlin/stop")
answer = rospy.ServiceProxy("merlin/stop", Trigger)()
print(answer.success, answer.message, flush=True)
"""


@pytest.fixture
def alone(master: Any) -> Any:
    """A guard that has begun."""
    master.api.setParam("/test", "/use_sim_time", False)
    guard = master.node(GUARD)
    return guard


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 0), (signal.SIGTERM, 143)])
def test_it_passes_what_has_a_goal_and_ends_as_a_node_does(
    master: Any, alone: Any, number: int, code: int
) -> None:
    driver = master.node(DRIVER)
    driver.expect("started")
    driver.say("drive")
    driver.expect("MOVES")
    if may_go_before_others(PRIORITY):
        assert os.getpriority(os.PRIO_PROCESS, alone.process.pid) == PRIORITY
    driver.say("end")
    driver.expect("STANDS")
    assert alone.end(number) == code
    assert "Traceback" not in alone.output


def test_in_a_slow_simulation_that_is_not_merlins_the_clock_counts(master: Any) -> None:
    master.api.setParam("/test", "/use_sim_time", True)
    guard, world = master.node(GUARD), master.node(SLOW)
    world.expect("MOVED True")
    assert "its status has been silent" not in guard.output


def test_a_wrong_parameter_ends_it_with_the_reason(master: Any) -> None:
    guard = master.node(GUARD, "_cancel_deadline:=soon")
    assert guard.ended() == 2
    assert "cancel_deadline" in guard.output
    assert "Traceback" not in guard.output


def test_a_second_one_leaves_the_first_alone(master: Any, alone: Any) -> None:
    driver = master.node(DRIVER)
    driver.expect("started")
    driver.say("drive")
    driver.expect("MOVES")
    address = master.address_of("/merlin_guard")
    second = master.node(GUARD)
    assert second.ended() == 2
    assert "node /merlin_guard runs already (process " in second.output
    assert master.address_of("/merlin_guard") == address
    driver.say("end")
    driver.expect("STANDS")


def test_a_master_that_hangs_ends_the_start_and_it_may_be_tried_again(master: Any) -> None:
    guard = master.node(LOOKS)
    guard.expect("LOOKS")
    master.process.send(signal.SIGSTOP)
    try:
        guard.say("go on")
        assert guard.ended() == 1
    finally:
        master.process.send(signal.SIGCONT)
    assert "the ROS master does not answer" in guard.output and "Traceback" not in guard.output


def test_a_stop_button_that_cannot_work_is_named(master: Any) -> None:
    master.api.setParam("/test", "/use_sim_time", False)
    guard = master.node(GUARD, "_stop_button:=4", "_server_wait:=0.1")
    guard.expect("nothing publishes /joy, so ~stop_button cannot stop the base")
    joystick = master.node(JOYSTICK)
    joystick.expect("started")
    joystick.say("4")
    joystick.expect("/joy has 4 buttons: it has no button 4, the ~stop_button")
    guard.expect("/joy has 4 buttons")
    joystick.say("5")
    joystick.expect("GUARD True stopped by button 4 of /joy")


def test_a_stop_is_confirmed_once_it_outlives_the_guard(master: Any) -> None:
    master.api.setParam("/test", "/use_sim_time", False)
    guard = master.node(ORDER)
    caller = master.node(STOPPER)
    caller.expect("True stopped until /merlin/release is called")
    guard.expect("TOLD")
    said = [line for line in guard.output.splitlines() if line.startswith(("TOLD", "KEPT"))]
    assert said[:2] == ["KEPT stopped by /stopper", "TOLD"]


def test_a_log_that_hangs_keeps_no_velocity_and_no_stop(master: Any) -> None:
    master.api.setParam("/test", "/use_sim_time", False)
    guard, driver = master.node(DUMB), master.node(DRIVER)
    guard.expect("HANGS")
    driver.expect("started")
    driver.say("drive")
    driver.expect("MOVES")
    master.node(STOPPER).expect("True stopped until /merlin/release is called")
    driver.expect("STANDS")


@pytest.mark.parametrize("since", ["soon", -1.0, 1e12])
def test_a_stop_outlives_a_time_that_makes_no_sense(master: Any, since: Any) -> None:
    master.api.setParam("/test", "/merlin_guard", {"stopped": "stopped by Ana", "stopped_since": since})
    guard = master.node(GUARD)
    guard.expect("stopped by Ana; it was so when the guard began")
    assert "Traceback" not in guard.output

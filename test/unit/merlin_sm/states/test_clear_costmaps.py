# SPDX-License-Identifier: Apache-2.0
"""After a drive that failed the costmaps are cleared, where they can be, and no drive waits long for it."""

import signal
from typing import Any, List

import pytest

pytestmark = pytest.mark.processes

# The first drive fails, each further one arrives. The word says how the service behaves.
NAVIGATION = """
import sys, threading
import actionlib, rospy
from move_base_msgs.msg import MoveBaseAction
from std_srvs.srv import Empty, EmptyResponse

rospy.init_node("driver")
drives = []

def say(line):
    print(line, flush=True)

def execute(goal):
    say("DRIVES")
    drives.append(goal)
    server.set_aborted(text="no way") if len(drives) == 1 else server.set_succeeded()

def clear(_):
    say("CLEARS")
    if sys.argv[1] == "hangs":
        threading.Event().wait()
    return EmptyResponse()

if sys.argv[1] != "lacks":
    rospy.Service(sys.argv[2] + "/clear_costmaps", Empty, clear)
server = actionlib.SimpleActionServer(sys.argv[2], MoveBaseAction, execute, auto_start=False)
server.start()
say("SERVES")
rospy.spin()
"""

CLIENT = """
import rospy, sys, threading
from geometry_msgs.msg import PoseStamped
from merlin_sm.states import navigation
from smach import UserData

rospy.init_node("client")
navigation.CLEAR_LIMIT = float(sys.argv[1])
drive = navigation.NavigationState(PoseStamped(), server_wait=60.0)

def run():
    print("END", drive.execute(UserData()), flush=True)

print("READY", flush=True)
for line in sys.stdin:
    if line.strip() == "cancel":
        drive.request_preempt()
    else:
        threading.Thread(target=run, daemon=True).start()
"""
LONG = "600"  # s: only a cancel can end the wait
SHORT = "0.5"


class Robot:
    """A drive and its server, after the first drive has failed."""

    def __init__(self, master: Any, service: str, limit: str, action: str = "move_base") -> None:
        self.navigation = master.node(NAVIGATION, service, action)
        self.navigation.expect("SERVES")
        self._client = master.node(CLIENT, limit, f"move_base:={action}")
        self._client.expect("READY")
        self.drive()
        assert self.end() == "END aborted"

    def drive(self) -> None:
        self._client.say("drive")

    def cancel(self) -> None:
        self._client.say("cancel")

    def end(self) -> str:
        return str(self._client.expect("END"))

    def did(self) -> List[str]:
        """What navigation did, in order; ends it."""
        self.navigation.end(signal.SIGKILL)
        return [line for line in self.navigation.lines if line in ("DRIVES", "CLEARS")]


@pytest.mark.parametrize(
    ("service", "limit", "does"),
    [
        ("clears", LONG, ["DRIVES", "CLEARS", "DRIVES", "DRIVES"]),
        ("lacks", LONG, ["DRIVES", "DRIVES", "DRIVES"]),
        ("hangs", SHORT, ["DRIVES", "CLEARS", "DRIVES", "DRIVES"]),
    ],
)
def test_the_costmaps_are_cleared_before_the_second_try(
    master: Any, service: str, limit: str, does: List[str]
) -> None:
    robot = Robot(master, service, limit)
    for _ in range(2):  # after a drive that arrived nothing is cleared
        robot.drive()
        assert robot.end() == "END succeeded"
    assert robot.did() == does


def test_the_parameter_says_that_they_stay_as_they_are(master: Any) -> None:
    master.api.setParam("/test", "/merlin/clear_costmaps", False)
    robot = Robot(master, "clears", LONG)
    robot.drive()
    assert robot.end() == "END succeeded"
    assert robot.did() == ["DRIVES", "DRIVES"]


def test_a_service_that_hangs_does_not_hold_up_a_cancel(master: Any) -> None:
    robot = Robot(master, "hangs", LONG)
    robot.drive()
    robot.navigation.expect("CLEARS")
    robot.cancel()
    assert robot.end() == "END preempted"
    assert robot.did() == ["DRIVES", "CLEARS"]


def test_an_action_of_another_name_is_reached_by_a_remapping(master: Any) -> None:
    robot = Robot(master, "clears", LONG, "/base/drive")
    robot.drive()
    assert robot.end() == "END succeeded"
    assert robot.did() == ["DRIVES", "CLEARS", "DRIVES"]

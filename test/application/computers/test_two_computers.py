# SPDX-License-Identifier: Apache-2.0
"""Two computers, as docs/real-robot.md sets them up: a robot with MERLIN and the master, and a laptop.

They are network namespaces of this machine, with names of their own.
"""

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any, Dict, Iterator, List

import pytest
from chaos.judging.events import Event
from chaos.under_test.network import ADDRESSES, MIND, ROBOT, Network, why_impossible

from merlin_test import LONG

pytestmark = [
    pytest.mark.processes,
    pytest.mark.skipif(bool(why_impossible()), reason=why_impossible() or "possible"),
]

LAPTOP = MIND
#: The robot: MERLIN beside action servers of its own, whose drives last until they are cancelled.
LAUNCH = """
<launch>
  <include file="$(find merlin_actions)/launch/simulated_servers.launch">
    <arg name="drive_duration" value="3600"/>
    <arg name="guard" value="true"/>
  </include>
  <include file="$(find merlin)/launch/include/application.launch">
    <arg name="on" value="robot"/>
    <arg name="world_file" value="$(find merlin)/pddl/home/points_of_interest.yaml"/>
    <arg name="state_file" value="run"/>
    <arg name="monitor" value="false"/>
  </include>
</launch>
"""
AWAITS = """
import sys
from merlin_executor.executor_client import MerlinExecutorClient
from merlin_executor.mission.readiness import wait_for_robot
from merlin_planning.knowledge_client import knowledge_client
from merlin_ros.node import init_node
init_node("awaits")
wait_for_robot(knowledge_client(), MerlinExecutorClient(), None, ("move_base",), float(sys.argv[1]))
print("complete")
"""
#: A plain node of rospy that is ready.
NODE = "import rospy; rospy.init_node('plain'); print('ready', flush=True); rospy.spin()"


class Computers:
    """The two, and the processes that a test starts on them."""

    def __init__(self, folder: Path) -> None:
        linked = threading.Event()

        def receive(event: Event) -> None:
            if event.kind == "linked":
                linked.set()

        self._folder = folder
        self._started: List[subprocess.Popen[str]] = []
        self._network = Network(f"two{os.getpid()}", dict(os.environ), folder, receive)
        if not linked.wait(LONG):
            self.close()
            raise AssertionError((folder / "link.err").read_text())

    def start(
        self, side: str, *command: str, name: str = "", address: bool = True
    ) -> "subprocess.Popen[str]":
        """Starts a command in a shell that is set up as the page says.

        :param name: of the computer, which has no address anywhere; empty: that of this machine.
        :param address: whether ROS_IP is set.
        """
        home = self._folder / side
        env: Dict[str, str] = {
            **os.environ,
            "ROS_MASTER_URI": f"http://{ADDRESSES[ROBOT]}:11311",
            "ROS_HOME": str(home),
            "ROS_LOG_DIR": str(home / "log"),
        }
        env.pop("ROS_HOSTNAME", None)
        env.pop("ROS_IP", None)
        if address:
            env["ROS_IP"] = ADDRESSES[side]
        named = ["unshare", "--uts", "sh", "-c", f'hostname {name} && exec "$@"', "sh"] if name else []
        process = subprocess.Popen(
            self._network.inside(side, [*named, *command]),
            env=env,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self._started.append(process)
        return process

    def ask(self, side: str, *command: str, **how: Any) -> str:
        """What a command says, once it has ended."""
        process = self.start(side, *command, **how)
        try:
            return process.communicate(timeout=LONG)[0]
        except subprocess.TimeoutExpired as error:
            raise AssertionError(f"{command} does not end") from error

    def close(self) -> None:
        for process in reversed(self._started):
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
                try:
                    process.communicate(timeout=LONG)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.communicate()
        self._network.close()


def read_until(process: "subprocess.Popen[str]", text: str) -> None:
    """Reads lines up to one with the text; pytest's own limit ends what says nothing."""
    read = []
    for line in process.stdout or ():
        read.append(line)
        if text in line:
            return
    raise AssertionError(f"ended without {text!r}:\n{''.join(read)}")


@pytest.fixture
def computers(tmp_path: Path) -> Iterator[Computers]:
    made = Computers(tmp_path)
    yield made
    made.close()


def test_the_laptop_sends_a_goal_to_the_robot_and_cancels_it(computers: Computers, tmp_path: Path) -> None:
    file = tmp_path / "robot.launch"
    file.write_text(LAUNCH, encoding="utf-8")
    computers.start(ROBOT, "roscore")
    computers.start(ROBOT, "roslaunch", "--wait", str(file))
    assert "complete" in computers.ask(LAPTOP, sys.executable, "-c", AWAITS, str(LONG))
    sent = computers.start(LAPTOP, "rosrun", "merlin", "send", "(checked kitchen)")
    read_until(sent, "(navigate")
    sent.send_signal(signal.SIGINT)
    said = sent.communicate(timeout=LONG)[0]
    assert sent.returncode == 130 and "cancelled" in said, said
    healthy = computers.ask(LAPTOP, "rosrun", "merlin", "doctor")
    assert "cannot be reached" not in healthy and "does not answer" not in healthy and "ROS_IP" not in healthy


def test_without_addresses_the_doctor_says_what_to_set_and_where(computers: Computers) -> None:
    computers.start(ROBOT, "roscore")
    read_until(computers.start(ROBOT, sys.executable, "-c", NODE, name="ann", address=False), "ready")
    said = computers.ask(LAPTOP, "rosrun", "merlin", "doctor", name="bob", address=False)
    assert "wrong: the master is on another computer; set ROS_IP to the address at which" in said, said
    assert "wrong: /plain cannot be reached from here at 'ann', so nothing of it arrives; set ROS_IP" in said
    assert "/etc/hosts" not in said and "Traceback" not in said

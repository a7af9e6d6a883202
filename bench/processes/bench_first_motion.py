# SPDX-License-Identifier: Apache-2.0
"""How long `rosrun merlin run home.launch` takes from its first process to the first motion of the robot."""

import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, Dict, List

from measuring.figures import figure
from measuring.ros_process import STOP_LIMIT, free_port

REPEATS = 3
LIMIT = 180.0  # s of wall time until the first motion
#: Waits for the first velocity, in a process of its own: a node belongs to one master for its life. It is
#: there before the launch begins: its own start would take time from the launch's.
WATCH = """
import sys, time, rospy, rosgraph
from nav_msgs.msg import Odometry
print("ready", flush=True)
master = rosgraph.Master("/first_motion")
while True:
    try:
        if any(topic == "/ground_truth" for topic, _ in master.getTopicTypes()):
            break
    except (OSError, rosgraph.MasterException):
        pass
    time.sleep(0.05)
rospy.init_node("first_motion", disable_signals=True)
while True:
    speed = rospy.wait_for_message("ground_truth", Odometry, float(sys.argv[1])).twist.twist
    if abs(speed.linear.x) > 0.01 or abs(speed.angular.z) > 0.01:
        break
print(time.monotonic())
"""


def first_motion() -> float:
    """Seconds of wall time from the start of the launch to the first motion.

    :raises RuntimeError: the launch has ended, or the robot does not move.
    :raises subprocess.TimeoutExpired: there is no topic of the robot's.
    """
    port = free_port()
    with tempfile.TemporaryDirectory(prefix="merlin_bench_") as folder:
        env = dict(os.environ, ROS_MASTER_URI=f"http://127.0.0.1:{port}", ROS_HOME=folder, ROS_LOG_DIR=folder)
        watch = subprocess.Popen(
            [sys.executable, "-c", WATCH, str(LIMIT)], env=env, stdout=subprocess.PIPE, text=True
        )
        assert watch.stdout is not None
        watch.stdout.readline()
        command = ["rosrun", "merlin", "run", "home.launch", f"port:={port}", "rtf:=1", "monitor_port:=8399"]
        with open(Path(folder) / "launch.out", "w") as output:
            begin = time.monotonic()
            launched = subprocess.Popen(
                [*command, f"results:={folder}/results"],
                env=env,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        try:
            reported, _ = watch.communicate(timeout=LIMIT)
            if watch.returncode:
                said = (Path(folder) / "launch.out").read_text()[-1000:]
                raise RuntimeError(f"the robot has not moved; the launch said: {said}")
            return float(reported) - begin
        finally:
            watch.kill()
            with contextlib.suppress(ProcessLookupError):
                launched.send_signal(signal.SIGINT)
            try:
                launched.wait(2 * STOP_LIMIT)
            except subprocess.TimeoutExpired:
                os.killpg(launched.pid, signal.SIGKILL)
                launched.wait()


def measure() -> Dict[str, Any]:
    samples: List[float] = [first_motion() for _ in range(REPEATS)]
    return {"home_first_motion_s": figure(samples)}

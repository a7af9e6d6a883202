# SPDX-License-Identifier: Apache-2.0
"""How fast one simulated world runs with one to four robots that drive, and what its processes cost.

As fast as possible (factor 0), without planning: simulator, navigation of each robot, and a client that
drives every robot from point to point. Half of the time each camera takes a picture per simulated second.
"""

import json
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any, Dict, List

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import rospy
from measuring.process_tree import descendants, processor
from measuring.ros_process import RosMaster
from merlin_msgs.srv import CaptureImage
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal

from merlin_reactive.pose import Pose
from merlin_reactive.ros_messages import stamped
from merlin_ros.actions.action_client import ActionClient
from merlin_ros.actions.client_goal import ClientGoal
from merlin_ros.service_proxy import ServiceProxy

LAUNCH = Path(__file__).resolve().parent / "robots.launch"
COUNTS = (1, 2, 3, 4)
SECONDS = 10.0  # of wall time that each measurement takes
START = 90.0  # s of wall time for the nodes to be up
PICTURES = "merlin_sim_pictures"  # the process that makes them
MEASURED = ("merlin_sim", PICTURES, "navigation")


class Tourist:
    """Drives one robot from point to point, forever; a goal that fails is followed by the next."""

    def __init__(self, robot: str, points: List[Pose], first: int) -> None:
        self._client = ActionClient(f"/{robot}/move_base", MoveBaseAction)
        self._points, self._next = points, first
        self.reached, self.sent = 0, 0
        self._lock = threading.Lock()  # guards what follows; taken by the client's thread and ours
        self._ended = False

    def start(self) -> None:
        """Waits for navigation and sends the first goal.

        :raises RuntimeError: it does not come.
        """
        if not self._client.wait_for_server(START):
            raise RuntimeError(f"no {self._client.name}")
        self._send()

    def end(self) -> None:
        """Sends nothing more."""
        with self._lock:
            self._ended = True
        self._client.shutdown()

    def _send(self) -> None:
        target = self._points[self._next % len(self._points)]
        self._next += 1
        self.sent += 1
        self._client.send(MoveBaseGoal(stamped(target, "map", rospy.Time.now())), on_done=self._done)

    def _done(self, goal: ClientGoal) -> None:
        with self._lock:
            if not self._ended:
                self.reached += goal.text == "Goal reached."
                self._send()


def one_count(count: int) -> Dict[str, Any]:
    """The figures with so many robots."""
    robots = [f"r{number + 1}" for number in range(count)]
    with RosMaster() as master:
        launched = master.launch(LAUNCH, robots=",".join(robots))
        master.wait_for_service(f"/{robots[-1]}/move_base/make_plan")
        rospy.init_node("bench_robots", disable_signals=True)
        places = rospy.get_param(f"/{robots[0]}/world/points_of_interest").values()
        points = [Pose(place["x"], place["y"], place["yaw"]) for place in places]
        tourists = [Tourist(robot, points, first) for first, robot in enumerate(robots)]
        for tourist in tourists:
            tourist.start()
        time.sleep(2.0)  # the first plans
        figures = _measured(launched.pid, lambda: time.sleep(SECONDS))
        cameras = [ServiceProxy(f"/{robot}/camera/capture", CaptureImage) for robot in robots]
        pictures = _measured(launched.pid, lambda: _look(cameras))
        figures["factor_with_cameras"] = pictures["factor"]
        figures[f"cpu_{PICTURES}"] = pictures[f"cpu_{PICTURES}"]
        for tourist in tourists:
            tourist.end()
        figures["goals_reached"] = f"{sum(t.reached for t in tourists)}/{sum(t.sent - 1 for t in tourists)}"
    return figures


def _look(cameras: List[ServiceProxy]) -> None:
    end, due = time.monotonic() + SECONDS, rospy.get_time()
    while time.monotonic() < end:
        for camera in cameras:
            camera()
        due = max(due + 1.0, rospy.get_time())
        rospy.sleep(due - rospy.get_time())


def _measured(pid: int, wait: Any) -> Dict[str, Any]:
    before, simulated, began = processor(descendants(pid)), rospy.get_time(), time.monotonic()
    wait()
    after, passed, took = processor(descendants(pid)), rospy.get_time() - simulated, time.monotonic() - began
    used = {key: round((after[key] - before.get(key, 0.0)) / passed, 4) for key in after}
    return {
        "factor": round(passed / took, 2),
        **{f"cpu_{key}": used.get(key, 0.0) for key in MEASURED},
        "cpu_all": round(sum(used.values()), 4),
    }


def measure() -> Dict[str, Any]:
    """Each count in a process of its own: rospy knows one master only."""
    results = {}
    for count in COUNTS:
        done = subprocess.run([sys.executable, __file__, str(count)], stdout=subprocess.PIPE, check=True)
        results[str(count)] = json.loads(done.stdout.decode().splitlines()[-1])
    return {"simulator_robots": results}


if __name__ == "__main__":
    print(json.dumps(one_count(int(sys.argv[1]))))

"""A node that starts lean has what every other has, once it asks for it."""

import os
import subprocess
import sys

import pytest

pytestmark = pytest.mark.processes


def run(text):
    done = subprocess.run(
        [sys.executable, "-c", f"import sys\nfrom merlin_ros import lean_start\n{text}"],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_what_is_not_asked_for_is_not_imported():
    assert not run(
        """
lean_start.prepare()
import rospy
from merlin_msgs.msg import PlannerStatus
PlannerStatus().header.stamp
import rosgraph
fat = {"numpy", "pyparsing", "unittest", "sensor_msgs.msg._Image", "merlin_msgs.msg._ExecuteGoal"}
print(*sorted(fat & set(sys.modules)))
"""
    ).strip()


def test_everything_is_there_when_it_is_asked_for():
    run(
        """
lean_start.prepare()
lean_start.prepare()
import rospy
from sensor_msgs.msg import *
assert PointCloud2 is sys.modules["sensor_msgs.msg._PointCloud2"].PointCloud2
from std_srvs.srv import Trigger, TriggerRequest, TriggerResponse
assert Trigger._request_class is TriggerRequest and Trigger._response_class is TriggerResponse
import geometry_msgs.msg
assert "PoseStamped" in dir(geometry_msgs.msg) and geometry_msgs.msg.PoseStamped().pose.position.x == 0
import roslib.message
assert roslib.message.get_message_class("nav_msgs/Odometry") is not None
import numpy
image = Image(data=numpy.zeros(4, numpy.uint8).tobytes(), height=numpy.uint32(2))
import io
image.serialize(io.BytesIO())
import std_msgs.msg
std_msgs.msg.Float64(numpy.float32(0.5)).serialize(io.BytesIO())
try:
    std_msgs.msg.Strin
except AttributeError as error:
    assert "Strin" in str(error)
else:
    raise SystemExit("a message that does not exist was found")
"""
    )


def test_the_search_for_files_works_when_it_is_called():
    run(
        """
lean_start.prepare()
import roslib.packages
assert roslib.packages.find_node("merlin_guard", "guard")
import catkin.find_in_workspaces as search
assert roslib.packages.find_node("merlin_guard", "guard")[0].endswith("/guard")
assert "get_workspaces" in dir(search) and callable(search.get_workspaces)
"""
    )


@pytest.mark.everywhere
def test_the_search_for_files_has_what_it_has():
    run(
        """
lean_start.prepare()
import catkin.find_in_workspaces as search
assert not hasattr(search, "nothing_of_this_name")
assert callable(search.get_workspaces) and search.find_in_workspaces.__module__ == search.__name__
"""
    )


@pytest.mark.parametrize(
    "module, fat",
    [
        ("merlin_sim.node.simulator_node", {"cv2", "scipy.stats", "matplotlib"}),
        ("merlin_reactive.navigation.navigation_node", {"cv2", "scipy.stats", "matplotlib"}),
        ("merlin_experiment.mission.measured_mission_node", {"cv2", "scipy", "matplotlib", "numpy"}),
        ("merlin_guard.guard_node", {"numpy"}),
    ],
)
def test_the_nodes_of_the_home_start_without_what_they_may_never_use(module, fat):
    text = f"lean_start.prepare()\nimport {module}\nprint(*{fat} & set(sys.modules))"
    assert not run(text).strip()


def test_a_patient_node_has_its_priority_back_when_it_runs(tmp_path):
    usual = os.getpriority(os.PRIO_PROCESS, 0)
    (tmp_path / "some_node.py").write_text(
        "import os, threading\n"
        "def nice(): return os.getpriority(os.PRIO_PROCESS, threading.get_native_id())\n"
        "imported = nice()\n"
        f"def main(): return 0 if (imported, nice()) == ({max(10, usual)}, {usual}) else 1\n"
    )
    text = f"sys.path.insert(0, {str(tmp_path)!r})\nlean_start.run('some_node', patient=True)"
    run(text)


@pytest.mark.everywhere
def test_a_patient_node_that_cannot_be_imported_says_why():
    text = "from merlin_ros import lean_start; lean_start.run('no_such_node', patient=True)"
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True)
    assert done.returncode == 1 and "no_such_node" in done.stderr


@pytest.mark.parametrize("returned, code", [(None, 0), (0, 0), (3, 3)])
def test_the_process_ends_with_what_the_function_returns(returned, code, tmp_path):
    (tmp_path / "some_node.py").write_text(f"def main():\n    return {returned}\n")
    text = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); from merlin_ros.lean_start import run; "
    done = subprocess.run([sys.executable, "-c", text + "run('some_node')"])
    assert done.returncode == code

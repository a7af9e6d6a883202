"""A node that starts lean has what every other has, once it asks for it."""

import subprocess
import sys

import pytest


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
print(*sorted({"numpy", "sensor_msgs.msg._Image", "merlin_msgs.msg._ExecuteGoal"} & set(sys.modules)))
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


@pytest.mark.parametrize("returned, code", [(None, 0), (0, 0), (3, 3)])
def test_the_process_ends_with_what_the_function_returns(returned, code, tmp_path):
    (tmp_path / "some_node.py").write_text(f"def main():\n    return {returned}\n")
    text = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); from merlin_ros.lean_start import run; "
    done = subprocess.run([sys.executable, "-c", text + "run('some_node')"])
    assert done.returncode == code

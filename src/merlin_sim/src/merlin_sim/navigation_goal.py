"""Checks what a client asks navigation for."""

import math

import rospy
import tf2_geometry_msgs  # noqa: F401 - teaches tf2 to transform PoseStamped
import tf2_ros
from geometry_msgs.msg import PoseStamped, Quaternion

from merlin_sim.ros_messages import pose_of
from merlin_sim.world import Pose

INVALID_QUATERNION_TEXT = "Aborting on goal because it was sent with an invalid quaternion"


class GoalError(Exception):
    """A goal that can never be driven to; the text is the answer to the client."""


def goal_pose(target: PoseStamped, frame: str, buffer: tf2_ros.Buffer) -> Pose:
    """The goal in the global frame.

    :raises GoalError: bad orientation, not finite, or a frame that tf does not know.
    """
    reason = bad_rotation(target.pose.orientation)
    if reason:
        raise GoalError(f"{INVALID_QUATERNION_TEXT}: {reason}")
    position = target.pose.position
    if not (math.isfinite(position.x) and math.isfinite(position.y)):
        raise GoalError(f"The goal position ({position.x}, {position.y}) is not finite")
    own = target.header.frame_id.lstrip("/")
    if not own:
        raise GoalError(f"The goal has no frame; {frame} is what it should be in")
    if own == frame:
        return pose_of(target.pose)
    latest = PoseStamped(header=target.header, pose=target.pose)
    latest.header.frame_id, latest.header.stamp = own, rospy.Time(0)
    try:
        return pose_of(buffer.transform(latest, frame).pose)
    except tf2_ros.TransformException as error:
        raise GoalError(
            f"The goal is in the frame {own}, which cannot be transformed to {frame}: {error}"
        ) from error


def bad_rotation(rotation: Quaternion) -> str:
    """Why a rotation is none about the vertical; empty when it is one."""
    values = (rotation.x, rotation.y, rotation.z, rotation.w)
    text = "({:g}, {:g}, {:g}, {:g})".format(*values)
    if not all(map(math.isfinite, values)):
        return f"{text} is not finite"
    square = sum(value * value for value in values)
    if square < 1e-6:
        return f"{text} has no length"
    upright = 1 - 2 * (rotation.x**2 + rotation.y**2) / square
    if abs(upright - 1.0) > 1e-3:
        return f"{text} does not turn about the vertical only"
    return ""

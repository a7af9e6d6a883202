# SPDX-License-Identifier: Apache-2.0
"""Checks what a client asks navigation for."""

import math

import rospy
import tf2_geometry_msgs  # noqa: F401 - teaches tf2 to transform PoseStamped
import tf2_ros
from geometry_msgs.msg import PoseStamped

from merlin_reactive.pose import Pose
from merlin_reactive.ros_messages import bad_rotation, pose_of

INVALID_QUATERNION_TEXT = "Aborting on goal because it was sent with an invalid quaternion"


class NavigationGoalError(Exception):
    """A goal that can never be driven to; the text is the answer to the client."""


def goal_pose(target: PoseStamped, frame: str, buffer: tf2_ros.Buffer) -> Pose:
    """The goal in the global frame.

    :raises NavigationGoalError: bad orientation, not finite, or a frame that tf does not know.
    """
    reason = bad_rotation(target.pose.orientation)
    if reason:
        raise NavigationGoalError(f"{INVALID_QUATERNION_TEXT}: {reason}")
    position = target.pose.position
    if not (math.isfinite(position.x) and math.isfinite(position.y)):
        raise NavigationGoalError(f"The goal position ({position.x}, {position.y}) is not finite")
    own = target.header.frame_id.lstrip("/")
    if not own:
        raise NavigationGoalError(f"The goal has no frame; {frame} is what it should be in")
    if own == frame:
        return pose_of(target.pose)
    latest = PoseStamped(header=target.header, pose=target.pose)
    latest.header.frame_id, latest.header.stamp = own, rospy.Time(0)
    try:
        return pose_of(buffer.transform(latest, frame).pose)
    except tf2_ros.TransformException as error:
        raise NavigationGoalError(
            f"The goal is in the frame {own}, which cannot be transformed to {frame}: {error}"
        ) from error

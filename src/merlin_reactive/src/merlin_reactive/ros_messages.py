# SPDX-License-Identifier: Apache-2.0
"""Conversions between this package's values and ROS messages."""

import math
from typing import List

import numpy as np
import rospy
from audio_common_msgs.msg import AudioData
from geometry_msgs.msg import Pose as PoseMessage
from geometry_msgs.msg import PoseStamped, Quaternion, TransformStamped
from nav_msgs.msg import OccupancyGrid as GridMessage
from nav_msgs.msg import Path as PathMessage

from merlin_reactive.occupancy_grid import OccupancyGrid
from merlin_reactive.pose import Point, Pose


def samples_of(message: AudioData) -> np.ndarray:
    """The samples (int16) of a piece of sound; half of one at its end is left out."""
    return np.frombuffer(message.data[: len(message.data) // 2 * 2], dtype="<i2")


def bad_rotation(rotation: Quaternion) -> str:
    """Why a rotation is not about the vertical axis; empty when it is."""
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


def quaternion(yaw: float) -> Quaternion:
    """A rotation about the vertical, rad."""
    return Quaternion(0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))


def yaw_of(rotation: Quaternion) -> float:
    """The rotation about the vertical that a quaternion (of any length but zero) holds, rad."""
    x, y, z, w = rotation.x, rotation.y, rotation.z, rotation.w
    return math.atan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z)


def pose_message(pose: Pose) -> PoseMessage:
    """A pose on the floor as a message."""
    message = PoseMessage(orientation=quaternion(pose.yaw))
    message.position.x, message.position.y = pose.x, pose.y
    return message


def pose_of(message: PoseMessage) -> Pose:
    """The part of a pose message that lies in the plane."""
    return Pose(message.position.x, message.position.y, yaw_of(message.orientation))


def stamped(pose: Pose, frame: str, stamp: rospy.Time) -> PoseStamped:
    """A pose on the floor, with frame and time."""
    message = PoseStamped(pose=pose_message(pose))
    message.header.frame_id, message.header.stamp = frame, stamp
    return message


def transform(pose: Pose, parent: str, child: str, stamp: rospy.Time) -> TransformStamped:
    """The pose of the frame `child` in the frame `parent`."""
    message = TransformStamped(child_frame_id=child)
    message.header.frame_id, message.header.stamp = parent, stamp
    message.transform.translation.x, message.transform.translation.y = pose.x, pose.y
    message.transform.rotation = quaternion(pose.yaw)
    return message


def pose_of_transform(message: TransformStamped) -> Pose:
    """The part of a transform that lies in the plane."""
    move = message.transform.translation
    return Pose(move.x, move.y, yaw_of(message.transform.rotation))


def hangs(message: TransformStamped) -> bool:
    """Whether the z axis of the child points down, as that of a laser that is mounted upside down."""
    rotation = message.transform.rotation
    return bool(rotation.x**2 + rotation.y**2 > 0.5)


def grid_of(message: GridMessage) -> OccupancyGrid:
    """A map from a message.

    :raises ValueError: when it is rotated, empty, without a resolution or a place, or does not hold what it
        announces.
    """
    info = message.info
    if info.width * info.height == 0 or len(message.data) != info.width * info.height:
        raise ValueError(f"the map announces {info.width} x {info.height} cells and has {len(message.data)}")
    if not (math.isfinite(info.resolution) and info.resolution > 0.0):
        raise ValueError(f"the map's cells are {info.resolution:g} m wide")
    if not abs(yaw_of(info.origin.orientation)) <= 1e-6:
        raise ValueError("the map is rotated, which is not supported")
    if not (math.isfinite(info.origin.position.x) and math.isfinite(info.origin.position.y)):
        raise ValueError("the map's origin is not finite")
    cells = np.array(message.data, dtype=np.int8).reshape(info.height, info.width)
    # map_server's convention: from 65 on a cell counts as occupied, in between as unknown.
    cells = np.where(cells >= 65, 100, np.where((cells >= 0) & (cells <= 19), 0, -1)).astype(np.int8)
    return OccupancyGrid(cells, info.resolution, (info.origin.position.x, info.origin.position.y))


def path_message(points: List[Point], frame: str, stamp: rospy.Time, last_yaw: float) -> PathMessage:
    """A path whose poses look along it; the last one has a yaw of its own, rad."""
    message = PathMessage()
    message.header.frame_id, message.header.stamp = frame, stamp
    for index, point in enumerate(points):
        if index + 1 < len(points):
            after = points[index + 1]
            yaw = math.atan2(after[1] - point[1], after[0] - point[0])
        else:
            yaw = last_yaw
        message.poses.append(stamped(Pose(*point, yaw), frame, stamp))
    return message

# SPDX-License-Identifier: Apache-2.0
"""The simulator's map and pictures as ROS messages."""

import numpy as np
import rospy
from nav_msgs.msg import OccupancyGrid as GridMessage
from sensor_msgs.msg import CameraInfo, Image

from merlin_reactive.occupancy_grid import OccupancyGrid
from merlin_reactive.pose import Pose
from merlin_reactive.ros_messages import pose_message
from merlin_sim.robot.camera import CameraModel


def grid_message(grid: OccupancyGrid, stamp: rospy.Time) -> GridMessage:
    """A map as a message."""
    message = GridMessage()
    message.header.frame_id, message.header.stamp = "map", stamp
    message.info.map_load_time = stamp
    message.info.resolution = grid.resolution
    message.info.height, message.info.width = grid.cells.shape
    message.info.origin = pose_message(Pose(*grid.origin))
    message.data = grid.cells.ravel().tolist()
    return message


def image_message(picture: np.ndarray, frame: str, stamp: rospy.Time) -> Image:
    """A picture, height x width x 3, RGB, as a message."""
    height, width = picture.shape[:2]
    message = Image(height=height, width=width, encoding="rgb8", step=3 * width)
    message.header.frame_id, message.header.stamp = frame, stamp
    message.data = np.ascontiguousarray(picture).tobytes()
    return message


def camera_info(model: CameraModel, frame: str, stamp: rospy.Time) -> CameraInfo:
    """The geometry of a camera without distortion as a message."""
    matrix = model.matrix()
    message = CameraInfo(height=model.height, width=model.width, distortion_model="plumb_bob", D=[0.0] * 5)
    message.header.frame_id, message.header.stamp = frame, stamp
    message.K = matrix.ravel().tolist()
    message.R = np.eye(3).ravel().tolist()
    message.P = np.hstack([matrix, np.zeros((3, 1))]).ravel().tolist()
    return message

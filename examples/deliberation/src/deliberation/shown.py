# SPDX-License-Identifier: Apache-2.0
"""The house and its robot for the page and rviz: a map, and where the robot is on it."""

import math
import threading

import rospy
from geometry_msgs.msg import Quaternion, TransformStamped, Vector3
from nav_msgs.msg import OccupancyGrid
from tf2_msgs.msg import TFMessage

from deliberation.simulation import Simulation
from merlin_ros.work.threads import start_thread

CELL = 0.05  # m
PERIOD = 0.1  # s of wall time between two positions


class Shown:
    """Publishes `map`, and the transform from frame map to base_footprint.

    :param simulation: what is shown.
    """

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._map = rospy.Publisher("map", OccupancyGrid, queue_size=1, latch=True)
        self._tf = rospy.Publisher("/tf", TFMessage, queue_size=10)
        self._over = threading.Event()

    def start(self) -> None:
        """Shows the map once, and the robot until :meth:`shutdown`."""
        x, y, cells = self._simulation.floor(CELL)
        grid = OccupancyGrid(data=cells.ravel().tolist())
        grid.header.frame_id = "map"
        grid.info.resolution = CELL
        grid.info.height, grid.info.width = cells.shape
        grid.info.origin.position.x, grid.info.origin.position.y = x, y
        grid.info.origin.orientation.w = 1.0
        self._map.publish(grid)
        start_thread("position", self._follow)

    def shutdown(self) -> None:
        """Shows no more."""
        self._over.set()

    def _follow(self) -> None:
        while not self._over.wait(PERIOD):
            x, y, yaw = self._simulation.pose()
            at = TransformStamped(child_frame_id="base_footprint")
            at.header.stamp, at.header.frame_id = rospy.Time.now(), "map"
            at.transform.translation = Vector3(x, y, 0.0)
            at.transform.rotation = Quaternion(0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
            self._tf.publish(TFMessage([at]))

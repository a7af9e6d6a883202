# SPDX-License-Identifier: Apache-2.0
"""What the simulator knows for certain, for the metrics only: where the robot is, and the map."""

import math
import threading
from typing import TYPE_CHECKING, Any, Callable, List, Tuple

import rospy
from nav_msgs.msg import OccupancyGrid, Odometry

from merlin_experiment.records.trajectory import Sample, Trajectory

if TYPE_CHECKING:
    import numpy as np

#: Occupancy (%) from which a cell counts as an obstacle.
OCCUPIED = 50


class GroundTruth:
    """Adds what comes on `ground_truth` to a trajectory."""

    def __init__(self, trajectory: Trajectory, on_sample: Callable[[Sample], None]) -> None:
        self._trajectory = trajectory
        self._on_sample = on_sample
        self._subscriber = rospy.Subscriber("ground_truth", Odometry, self._receive, tcp_nodelay=True)

    def _receive(self, message: Odometry) -> None:
        position, turn = message.pose.pose.position, message.pose.pose.orientation
        twist = message.twist.twist
        sample = Sample(
            message.header.stamp.to_sec(),
            position.x,
            position.y,
            math.atan2(2 * (turn.w * turn.z + turn.x * turn.y), 1 - 2 * (turn.y**2 + turn.z**2)),
            math.hypot(twist.linear.x, twist.linear.y),
            twist.angular.z,
        )
        self._trajectory.add(sample)
        self._on_sample(sample)


def receive_one(topic: str, message_class: Any, timeout: float) -> Any:
    """The first message of a topic; None when none comes.

    :param topic: a latched one, or one that is published often.
    :param timeout: wall seconds; rospy's own wait counts ROS time, which may stand still.
    """
    arrived = threading.Event()
    messages: List[Any] = []

    def receive(message: Any) -> None:
        messages.append(message)
        arrived.set()

    subscriber = rospy.Subscriber(topic, message_class, receive)
    arrived.wait(timeout)
    subscriber.unregister()
    return messages[0] if messages else None


def grid_of(message: OccupancyGrid) -> Tuple["np.ndarray", float, Tuple[float, float]]:
    """The cells that are obstacles or unknown (row = y, column = x), the resolution and the origin (m)."""
    import numpy as np  # wanted with the results only: the start does not wait for it

    cells = np.asarray(message.data, dtype=np.int8).reshape(message.info.height, message.info.width)
    origin = message.info.origin.position
    return (cells < 0) | (cells >= OCCUPIED), message.info.resolution, (origin.x, origin.y)

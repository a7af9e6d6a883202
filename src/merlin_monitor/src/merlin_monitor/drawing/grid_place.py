"""Where an occupancy grid lies in its frame, in which it may be turned."""

import math
from typing import Any, Dict

import numpy


def yaw_of(rotation: Any) -> float:
    """The yaw of a geometry_msgs/Quaternion, rad."""
    sine = 2.0 * (rotation.w * rotation.z + rotation.x * rotation.y)
    cosine = 1.0 - 2.0 * (rotation.y * rotation.y + rotation.z * rotation.z)
    return math.atan2(sine, cosine)


def grid_place(info: Any) -> Dict[str, Any]:
    """Origin (m), yaw (rad) and size (m) of a nav_msgs/MapMetaData, and as ``box`` what it covers."""
    width, height = info.width * info.resolution, info.height * info.resolution
    x, y, yaw = info.origin.position.x, info.origin.position.y, yaw_of(info.origin.orientation)
    corners = numpy.array([(0.0, 0.0), (width, 0.0), (0.0, height), (width, height)]) @ _turn(yaw).T + (x, y)
    low, high = corners.min(axis=0), corners.max(axis=0)
    box = dict(zip(("x", "y", "width", "height"), map(float, (*low, *(high - low)))))
    return {"x": x, "y": y, "yaw": yaw, "width": width, "height": height, "box": box}


def cells_of(info: Any, points: Any) -> Any:
    """The column and row of each point, also beyond the grid; points are x and y in m, one in each row."""
    origin = info.origin.position
    # Turned back by the inverse of the turn, which is its transpose.
    within = (points - (origin.x, origin.y)) @ _turn(yaw_of(info.origin.orientation))
    return numpy.floor(within / info.resolution).astype(int).T


def _turn(yaw: float) -> Any:
    return numpy.array([(math.cos(yaw), -math.sin(yaw)), (math.sin(yaw), math.cos(yaw))])

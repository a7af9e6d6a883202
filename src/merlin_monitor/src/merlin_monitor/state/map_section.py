"""The section of the map: the map's picture, the robot, its path, points of interest and people on it."""

import struct
import zlib
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple

import numpy

from merlin_monitor.state.state_tree import StateTree

SECTION = "map"
LONGEST_PATH = 300  # points that are shown
MOST_PEOPLE = 200
ABSENT = 0  # state of a simulated person who is not there
SHOWN = 0  # action of a marker that is not to be deleted
_INK = {"free": 0, "unknown": 40, "occupied": 255}  # opacity


class MapSection:
    """Keeps the section ``map`` of the state; the picture itself is fetched by the page."""

    def __init__(self, tree: StateTree) -> None:
        self._tree = tree
        self.picture: Optional[bytes] = None
        self._version = 0

    def grid(self, message: Any) -> None:
        """Takes a message with the fields of nav_msgs/OccupancyGrid."""
        info = message.info
        self.picture = grid_picture(message.data, info.width, info.height)
        self._version += 1
        self._tree.set(
            SECTION,
            "grid",
            {
                "version": self._version,
                "width": info.width * info.resolution,
                "height": info.height * info.resolution,
                "x": info.origin.position.x,
                "y": info.origin.position.y,
                "frame": message.header.frame_id,
            },
        )

    def robot(self, pose: Optional[Tuple[float, float, float]]) -> None:
        """Where the robot is, m and rad in the map's frame; None: not known."""
        shown = None if pose is None else [round(pose[0], 3), round(pose[1], 3), round(pose[2], 3)]
        self._tree.set(SECTION, "robot", shown)

    def path(self, points: Sequence[Tuple[float, float]]) -> None:
        """The way the robot means to take, m; none: it is not going anywhere."""
        stride = max(1, -(-len(points) // LONGEST_PATH))
        shown = [[round(x, 2), round(y, 2)] for x, y in points[::stride]]
        if points and stride > 1:
            shown.append([round(points[-1][0], 2), round(points[-1][1], 2)])
        self._tree.set(SECTION, "path", shown)

    def goal(self, pose: Optional[Tuple[float, float, float]]) -> None:
        """Where it is going."""
        self._tree.set(SECTION, "goal", None if pose is None else [round(value, 3) for value in pose])

    def points(self, parameter: Any) -> List[str]:
        """Takes ``world/points_of_interest``: name → x, y, yaw. Returns the names."""
        points: Dict[str, List[float]] = {}
        for name, place in (parameter if isinstance(parameter, dict) else {}).items():
            try:
                points[name] = [float(place["x"]), float(place["y"]), float(place.get("yaw", 0.0))]
            except (TypeError, KeyError, ValueError, AttributeError):
                continue  # another node's parameter of that name
        self._tree.set(SECTION, "points", points)
        return list(points)

    def people(self, message: Any) -> None:
        """Takes people from a PoseArray, a People, a MarkerArray or a SimPeople, read by their fields."""
        people: List[List[float]] = []
        position_of: Dict[str, Callable[[Any], Any]] = {
            "poses": lambda pose: pose.position,
            "people": lambda person: getattr(person, "position", person),
            "markers": lambda marker: marker.pose.position,
        }
        for attribute, position in position_of.items():
            for item in getattr(message, attribute, ()):
                if getattr(item, "state", None) == ABSENT or getattr(item, "action", SHOWN) != SHOWN:
                    continue
                where = position(item)
                people.append([round(where.x, 2), round(where.y, 2)])
        self._tree.set(SECTION, "people", people[:MOST_PEOPLE])


def grid_picture(data: Sequence[int], width: int, height: int) -> bytes:
    """An occupancy grid as PNG: black, more or less opaque, north up; the page turns black into its ink."""
    cells = numpy.asarray(data, dtype=numpy.int8)
    if width <= 0 or height <= 0 or cells.size != width * height:
        cells, width, height = numpy.full(1, -1, dtype=numpy.int8), 1, 1
    alpha = numpy.full(cells.shape, _INK["unknown"], dtype=numpy.uint8)
    alpha[cells == 0] = _INK["free"]
    known = cells > 0
    alpha[known] = (cells[known].astype(numpy.uint16) * _INK["occupied"] // 100).clip(0, 255)
    rows = numpy.zeros((height, width, 2), dtype=numpy.uint8)
    rows[:, :, 1] = alpha.reshape(height, width)[::-1]
    filtered = numpy.zeros((height, 1 + width * 2), dtype=numpy.uint8)
    filtered[:, 1:] = rows.reshape(height, width * 2)
    header = struct.pack(">IIBBBBB", width, height, 8, 4, 0, 0, 0)  # 8 bit grey with opacity
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        _chunk(kind, body)
        for kind, body in (
            (b"IHDR", header),
            (b"IDAT", zlib.compress(filtered.tobytes(), 6)),
            (b"IEND", b""),
        )
    )


def _chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

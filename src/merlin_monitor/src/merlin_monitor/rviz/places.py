"""Which point of interest is meant by a place on the map."""

import math
from typing import Mapping, Sequence


class NoPlace(ValueError):
    """No point of interest is at that place; the text names the nearest one."""


def nearest(points: Mapping[str, Sequence[float]], x: float, y: float, reach: float) -> str:
    """The name of the point of interest nearest to a place.

    :param points: name → x and y, m.
    :param reach: m; one that is further away is not meant.
    :raises NoPlace: when none is meant.
    """
    if not (math.isfinite(x) and math.isfinite(y)):
        raise NoPlace("the place is not a pair of finite numbers")
    if not points:
        raise NoPlace("there are no points of interest")
    distances = {name: math.hypot(point[0] - x, point[1] - y) for name, point in points.items()}
    name = min(distances, key=lambda each: distances[each])
    if distances[name] > reach:
        raise NoPlace(
            f"no point of interest within {reach:g} m of ({x:.2f}, {y:.2f}); "
            f"the nearest is {name}, {distances[name]:.2f} m away"
        )
    return name

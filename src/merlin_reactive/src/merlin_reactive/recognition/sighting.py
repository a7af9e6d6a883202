# SPDX-License-Identifier: Apache-2.0
"""One thing that was recognised in a picture."""

from dataclasses import dataclass
from typing import List, Tuple

from merlin_reactive.recognition.camera_view import Box

CARDS = 0.3  # m between two sightings of one tag that are of one thing


@dataclass(frozen=True)
class Sighting:
    """A thing and its place.

    :param name: its class; of a tag `tag_<number>`.
    :param score: 0..1, how well it fits its class.
    :param position: of its middle, map frame, m.
    :param size: along x, y, z of its own frame, m.
    :param box: in the picture.
    :param turn: quaternion x, y, z, w, map frame.
    :param spread: standard deviation of the position to be expected, m.
    :param depth_from: what its distance follows from.
    """

    name: str
    score: float
    position: Tuple[float, float, float]
    size: Tuple[float, float, float]
    box: Box
    turn: Tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    spread: float = 0.05
    depth_from: str = "size"

    def distance(self, other: "Sighting") -> float:
        """Between two middles, m."""
        return float(sum((a - b) ** 2 for a, b in zip(self.position, other.position)) ** 0.5)


def merge(sightings: List[Sighting]) -> List[Sighting]:
    """Best score first; of several of one name in one place the best."""
    kept: List[Sighting] = []
    # Things do not overlap; a tag's four cards are on one thing.
    for new in sorted(sightings, key=lambda sighting: -sighting.score):
        apart = CARDS if new.depth_from == "tag" else 0.7 * max(new.size[:2])
        if all(new.name != old.name or new.distance(old) > apart for old in kept):
            kept.append(new)
    return kept

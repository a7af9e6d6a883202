# SPDX-License-Identifier: Apache-2.0
"""The monitor's state as markers: points of interest, people, the goal of the drive, and the plan as text."""

import math
from typing import Any, Dict, Iterator, List, Optional, Sequence, Tuple

import rospy
from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from merlin_monitor.state.monitor_model import MonitorModel
from merlin_monitor.text.phrase import in_english
from merlin_ros.publishing import OnSubscriber, publish
from merlin_ros.work.threads import CallQueue

NEXT_STEPS = 3  # that are written
LONGEST_LINE = 80  # characters
MOST = 200  # points, and people
FLAT = 0.02  # m, height of what lies on the floor
LETTERS = 0.3  # m
OVER = 1.7  # m, height of names: over what stands there, seen from above
HEADLINE = 0.4  # m, letters of goal and plan
_RUNNING = ("dispatched", "running")

Colour = Tuple[float, float, float, float]
POINT: Colour = (0.10, 0.35, 0.75, 0.8)
PERSON: Colour = (0.85, 0.45, 0.10, 0.9)
GOAL: Colour = (0.10, 0.60, 0.25, 0.9)
INK: Colour = (0.05, 0.05, 0.10, 1.0)


def markers(state: Dict[str, Any], frame: str) -> List[Marker]:
    """All markers; the first one removes those of before.

    :param state: the sections ``map``, ``now`` and ``plan`` of the monitor's state.
    :param frame: of the map.
    """
    shown = state.get("map") or {}
    drawn = [Marker(action=Marker.DELETEALL)]
    for name, (x, y, _) in sorted((shown.get("points") or {}).items())[:MOST]:
        drawn.append(_solid("points", Marker.CYLINDER, (x, y, FLAT / 2), (0.3, 0.3, FLAT), POINT))
        drawn.append(_text("point names", name.replace("_", " "), (x, y - 0.4, OVER), LETTERS))
    for x, y, *names in (shown.get("people") or [])[:MOST]:
        drawn.append(_solid("people", Marker.CYLINDER, (x, y, 0.8), (0.4, 0.4, 1.6), PERSON))
        drawn += [_text("people's names", str(name), (x, y + 0.4, OVER), LETTERS) for name in names]
    if shown.get("goal"):
        x, y, yaw = shown["goal"]
        drawn.append(_solid("goal", Marker.ARROW, (x, y, 0.1), (0.6, 0.1, 0.1), GOAL, yaw))
    text = "\n".join(headline(state))
    if text:
        drawn.append(_text("plan", text, _above(shown.get("grid") or {}, text), HEADLINE))
    for number, marker in enumerate(drawn):
        marker.header.frame_id, marker.id = frame, number
    return drawn


def headline(state: Dict[str, Any]) -> Iterator[str]:
    """The lines about goal and plan: the Executor's goal, what runs, and the next steps."""
    goals = ((state.get("now") or {}).get("executor") or {}).get("words") or []
    if not goals:
        return
    yield _line("goal", ", ".join(map(in_english, goals)))
    plan = state.get("plan") or {}
    steps = [plan["steps"][key] for key in plan.get("order") or [] if key in plan.get("steps", {})]
    running = [in_english(step["words"]) for step in steps if step["state"] in _RUNNING]
    waiting = [in_english(step["words"]) for step in steps if step["state"] == "waiting"]
    if running:
        yield _line("now", ", ".join(running))
    for text in waiting[:NEXT_STEPS]:
        yield _line("then", text)
    if len(waiting) > NEXT_STEPS:
        yield f"and {len(waiting) - NEXT_STEPS} more"


def _line(what: str, text: str) -> str:
    line = f"{what}: {' '.join(text.split())}"
    return line if len(line) <= LONGEST_LINE else f"{line[: LONGEST_LINE - 3]}..."


def _above(grid: Dict[str, Any], text: str) -> Tuple[float, float, float]:
    """Where a text stands beyond the upper edge of the map, so that it hides nothing of it."""
    grid = grid.get("box") or grid
    x = grid.get("x", 0.0) + grid.get("width", 0.0) / 2
    y = grid.get("y", 0.0) + grid.get("height", 0.0)
    return x, y + HEADLINE * (text.count("\n") + 2) / 2, FLAT


def _solid(
    name: str, kind: int, place: Sequence[float], size: Sequence[float], colour: Colour, yaw: float = 0.0
) -> Marker:
    turned = Quaternion(z=math.sin(yaw / 2), w=math.cos(yaw / 2))
    pose = Pose(position=Point(*place), orientation=turned)
    return Marker(ns=name, type=kind, pose=pose, scale=Vector3(*size), color=ColorRGBA(*colour))


def _text(name: str, text: str, place: Sequence[float], letters: float) -> Marker:
    marker = _solid(name, Marker.TEXT_VIEW_FACING, place, (0.0, 0.0, letters), INK)
    marker.text = text
    return marker


class MarkerPublisher:
    """Publishes the markers whenever they change, while there is a subscriber.

    :param state: what is shown.
    :param frame: of the map.
    """

    def __init__(self, state: MonitorModel, frame: str) -> None:
        self._state = state
        self._frame = frame
        self._last: Optional[List[Marker]] = None  # drawn ones; of the queue's thread
        self._queue = CallQueue("markers")
        self._feed = state.tree.subscribe(lambda: self._queue.put(self._draw))
        # A new subscriber gets what is shown now.
        greeter = OnSubscriber(lambda _: self._queue.put(self._draw, True))
        self._topic = rospy.Publisher("merlin/markers", MarkerArray, greeter, queue_size=2)

    def stop(self) -> None:
        """Follows what is shown no more."""
        self._feed.close()

    def _draw(self, newcomer: bool = False) -> None:
        self._feed.take()
        if not self._topic.get_num_connections():
            return
        drawn = markers(self._state.tree.snapshot()[1], self._frame)
        if newcomer or drawn != self._last:
            self._last = drawn
            publish(self._topic, MarkerArray(drawn))

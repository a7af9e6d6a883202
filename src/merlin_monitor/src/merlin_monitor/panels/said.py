# SPDX-License-Identifier: Apache-2.0
"""The panel of what the robots said, heard and saw."""

from typing import Any, Callable, Dict, List, Tuple

import numpy
from merlin_msgs.msg import ListenActionResult, RecognizeActionResult
from sensor_msgs.msg import Image
from sound_play.msg import SoundRequest, SoundRequestActionGoal

from merlin_monitor.history.pictures import Pictures, png
from merlin_monitor.listeners.panel import Panel, PlanRobots
from merlin_monitor.listeners.ros_system import RosSystem
from merlin_monitor.state.history_events import Reporter, sentence
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_monitor.state.state_tree import StateTree
from merlin_monitor.text.phrase import Phrase, say

SAY = -3  # sound_play's number of a text
MOST = 12  # things that are kept
WIDEST = 480  # px of the picture
_CHANNELS = {"rgb8": (0, 1, 2), "bgr8": (2, 1, 0), "mono8": (0,), "rgba8": (0, 1, 2), "bgra8": (2, 1, 0)}
_BYTES = {"rgb8": 3, "bgr8": 3, "mono8": 1, "rgba8": 4, "bgra8": 4}


class SaidPanel(Panel):
    """The last sentences, what was understood of people, and the last look with its picture."""

    name, title, place, width = "said", "Said, heard, seen", 35, 7

    def __init__(self, state: MonitorModel, ros: RosSystem) -> None:
        super().__init__(state, ros)
        self._said = SaidSection(state.tree, state.pictures, state.report)
        self._subscribers = self._follow("")
        self._others = PlanRobots(self, self._follow)

    def look(self, topics: Dict[str, str]) -> None:
        """Notices the robots of one plan."""
        self._others.look()

    def _follow(self, robot: str) -> List[Any]:
        section, below = self._said, f"/{robot}/" if robot else ""
        takes: Dict[str, Tuple[type, Callable[[Any, float], object]]] = {
            "sound_play/goal": (
                SoundRequestActionGoal,
                lambda message, at: section.spoken(message.goal.sound_request, at, robot),
            ),
            "robotsound": (SoundRequest, lambda message, at: section.spoken(message, at, robot)),
            "listen/result": (ListenActionResult, lambda end, at: section.heard(end.result, at, robot)),
            "recognize/result": (
                RecognizeActionResult,
                lambda end, at: section.seen(_names(end.result), at, robot),
            ),
            "recognition/image": (Image, lambda message, at: section.image(message, robot)),
        }
        return [
            self.subscribe(f"{below}{topic}", kind, take, queue_size=1 if kind is Image else 100)
            for topic, (kind, take) in takes.items()
        ]


class SaidSection:
    """Keeps the section ``said`` of the state; the page fetches the picture itself.

    In all methods `robot` is the name of one of several robots, empty for the only one.

    :param pictures: takes it, as ``seen``.
    """

    def __init__(self, tree: StateTree, pictures: Pictures, report: Reporter) -> None:
        self._tree = tree
        self._report = report
        self._pictures = pictures
        tree.set("said", "entries", [])

    def spoken(self, request: Any, at: float, robot: str = "") -> None:
        """Takes a message with the fields of sound_play/SoundRequest; sounds that are not texts count not."""
        if request.sound == SAY and request.arg.strip():
            words = request.arg.strip()
            self._add("said", words, at, robot, say("said “{words}”", words=words))

    def heard(self, result: Any, at: float, robot: str = "") -> None:
        """Takes a message with the fields of merlin_msgs/ListenResult."""
        if result.heard:
            unclear = say("something that was not understood")
            heard = (
                say("heard “{words}”", words=result.text)
                if result.text
                else say("heard {what}", what=unclear)
            )
            self._add("heard", result.text or unclear, at, robot, heard)

    def seen(self, names: List[str], at: float, robot: str = "") -> None:
        """Takes what a look has found."""
        counts = {name: names.count(name) for name in names}
        shown = [f"{count} × {name}" if count > 1 else name for name, count in counts.items()]
        listed: List[Phrase] = [name.replace("_", " ") for name in shown]
        found = listed or say("nothing of what it knows")
        self._add("seen", found, at, robot, say("saw {what}", what=found))

    def image(self, message: Any, robot: str = "") -> None:
        """Takes a message with the fields of sensor_msgs/Image; other encodings are left out."""
        channels, size = _CHANNELS.get(message.encoding), _BYTES.get(message.encoding, 1)
        if channels is None or len(message.data) < message.step * message.height or message.width < 1:
            return
        rows = numpy.frombuffer(message.data, dtype=numpy.uint8)[: message.step * message.height]
        rows = rows.reshape(message.height, message.step)[:, : message.width * size]
        pixels = rows.reshape(message.height, message.width, size)
        stride = max(1, -(-message.width // WIDEST))
        picture = png(numpy.ascontiguousarray(pixels[::stride, ::stride, list(channels)]))
        self._tree.put("said", picture=self._pictures.put("seen", picture), looked=robot)

    def _add(self, kind: str, words: Phrase, at: float, robot: str, said: Phrase) -> None:
        before = self._tree.get("said", "entries")
        number = before[0]["number"] + 1 if before else 1
        entry = {"number": number, "kind": kind, "words": words, "at": at, "robot": robot}
        self._tree.set("said", "entries", [entry, *before][:MOST])
        said = say("{node} {what}", node=robot, what=said) if robot else said
        self._report(sentence("sight" if kind == "seen" else "speech", said, at))


def _names(result: Any) -> List[str]:
    found = [_best(detection, list(result.names)) for detection in result.detections.detections]
    return [name for name in found if name]


def _best(detection: Any, names: Any) -> str:
    best = max(detection.results, key=lambda hypothesis: hypothesis.score, default=None)
    return names[best.id] if best is not None and 0 <= best.id < len(names) else ""

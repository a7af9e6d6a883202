# SPDX-License-Identifier: Apache-2.0
"""Makes a history of a bag: its messages go through the panels, as a robot's do, at their own times."""

import concurrent.futures
import contextlib
import sys
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple

import genpy
import numpy
import rosgraph.names
import tf2_ros
from tf2_msgs.msg import TFMessage

from merlin_monitor.bag.recording import BagRecording, Message, parameter_tree
from merlin_monitor.history.history_file import HistoryError
from merlin_monitor.listeners.ros_system import TRANSFORMS_KEPT, RosSystem, TopicGraph
from merlin_monitor.panel_board import OFFERED, PanelBoard, foreign_panel, script_of
from merlin_monitor.panels.control import sentences_of_node
from merlin_monitor.state.history_store import HistoryStore
from merlin_monitor.state.inbox import DirectInbox
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_ros.parameters import ParameterError

#: Name of the node whose parameters a recording has.
MONITOR = "merlin_monitor"
SIMULATOR = "/merlin_sim/status"
SLOWEST = 0.01  # factor of a simulation; below it is a pause, in which ROS time does not continue


class BagClock:
    """Puts ROS time into s since 1970, and back.

    On a robot they are the same. The messages of a simulation lie at its own time, which begins at 0 and
    is faster or slower.

    :param begin: s of ROS time.
    :param end: s of ROS time.
    :param factors: of a simulation: s of ROS time, and how fast it was up to then; none: a robot.
    :param written: s since 1970 when the bag of a simulation was ended.
    """

    def __init__(
        self, begin: float, end: float, factors: Sequence[Tuple[float, float]] = (), written: float = 0.0
    ) -> None:
        if not factors:
            self._times = self._walls = numpy.array([begin, end])
            return
        inside = [(at, factor) for at, factor in factors if begin < at < end]
        times = numpy.array([begin, *(at for at, _ in inside), end])
        speeds = numpy.array([*(factor for _, factor in inside), factors[-1][1]])
        passed = numpy.diff(times) / numpy.maximum(speeds, SLOWEST)
        walls = numpy.concatenate(([0.0], numpy.cumsum(passed)))
        self._times, self._walls = times, walls + (written - walls[-1])

    @property
    def begin(self) -> float:
        """Wall time of the first message, s since 1970."""
        return float(self._walls[0])

    @property
    def end(self) -> float:
        """Wall time of the last message, s since 1970."""
        return float(self._walls[-1])

    def wall(self, at: float) -> float:
        """s since 1970 at a ROS time."""
        return float(numpy.interp(at, self._times, self._walls))

    def time(self, wall: float) -> float:
        """ROS time, s."""
        return float(numpy.interp(wall, self._walls, self._times))


class RecordedSystem(RosSystem):
    """What panels ask, answered by a recording. Nothing is asked of a master, and nothing published.

    :param recording: its messages arrive one by one, by :meth:`deliver`.
    """

    def __init__(self, recording: BagRecording) -> None:
        self._recording = recording
        self._namespace = f"/{recording.namespace}/".replace("//", "/")
        self._parameters = parameter_tree(recording.parameters)
        factors = [(each.at.to_sec(), each.read().achieved_factor) for each in recording.of_topic(SIMULATOR)]
        self._simulated = bool(factors)
        self.clock = BagClock(recording.begin, recording.end, factors, recording.written)
        self._at, self._wall = recording.begin, self.clock.begin
        self._receivers: Dict[str, List[_Receiver]] = {}
        self._senders: Dict[str, List[str]] = {}  # topic → the nodes that have published, the last one first

    def go_to(self, wall: float) -> None:
        """Advances time.

        :param wall: s since 1970.
        """
        self._at, self._wall = self.clock.time(wall), wall

    def deliver(self, message: Message) -> None:
        """Gives a message to those that follow its topic, at its own time.

        :raises RecordingError: it cannot be read.
        """
        self._at = message.at.to_sec()
        self._wall = max(self._wall, self.clock.wall(self._at))
        others = [node for node in self._senders.get(message.topic, ()) if node != message.sender]
        self._senders[message.topic] = [message.sender, *others]
        for receiver in list(self._receivers.get(message.topic, ())):
            if receiver.message_class._type == message.type:
                receiver.take(self._read(message, receiver.message_class))

    # --- what panels ask ------------------------------------------------------------------------------------

    @property
    def namespace(self) -> str:
        """Namespace of the recorded robot."""
        return self._namespace

    @property
    def name(self) -> str:
        """None: what the monitor of then has done was done by another node."""
        return ""

    def resolve(self, name: str) -> str:
        """A global name, as in the monitor of the robot."""
        return str(rosgraph.names.resolve_name(name, self._namespace + MONITOR))

    def parameter(self, name: str, default: Any) -> Any:
        """A parameter of then."""
        path = self.resolve(name)
        if path == "/use_sim_time":
            return self._simulated
        value: Any = self._parameters
        for part in path.strip("/").split("/"):
            if not isinstance(value, dict) or part not in value:
                return default
            value = value[part]
        return value

    def clock_set(self) -> float:
        """Not known of then."""
        return 0.0

    def time(self) -> float:
        """ROS time of then, s."""
        return self._at

    def wall(self) -> float:
        """s since 1970 of then."""
        return self._wall

    def silence_clock(self) -> float:
        """As `wall`: a recording misses nothing."""
        return self._wall

    def subscribe(
        self, topic: str, message_class: type, receive: Callable[[Any], object], **options: Any
    ) -> Any:
        """A subscriber, of which the panels ask what they ask of rospy's."""
        receiver = _Receiver(self.resolve(topic), message_class, receive, self._receivers)
        self._receivers.setdefault(receiver.resolved_name, []).append(receiver)
        return receiver

    def publisher(self, topic: str, message_class: type) -> Any:
        """Nothing that is published arrives anywhere."""
        return SimpleNamespace(publish=lambda message: None)

    def transforms(self) -> Callable[[str, str], Any]:
        """Follows the transforms of then."""
        buffer = tf2_ros.BufferCore(genpy.Duration.from_sec(TRANSFORMS_KEPT))

        def take(put: Callable[[Any, str], object], message: Any) -> None:
            for transform in message.transforms:
                put(transform, "")

        self.subscribe("/tf", TFMessage, partial(take, buffer.set_transform))
        self.subscribe("/tf_static", TFMessage, partial(take, buffer.set_transform_static))
        return lambda target, source: buffer.lookup_transform_core(target, source, genpy.Time(0))

    def graph(self) -> Optional[TopicGraph]:
        """All topics of the recording, from its begin on; their nodes as they come."""
        return TopicGraph(self._senders, dict(self._recording.topics))

    def hangs(self, node: str) -> bool:
        """Never: a recording answers no question."""
        return False

    def address_of(self, service: str) -> str:
        """Always empty: a recording serves nothing."""
        return ""

    def _read(self, message: Message, message_class: Any) -> Any:
        # Of another version of a package the class that lies in the bag.
        found = message.read(message_class if message_class._md5sum == message.raw[2] else None)
        found._connection_header = {"callerid": message.sender}
        return found


class _Receiver:
    """A subscriber of a topic of the bag."""

    def __init__(
        self,
        name: str,
        message_class: Any,
        receive: Callable[[Any], object],
        receivers: Dict[str, List["_Receiver"]],
    ) -> None:
        self.resolved_name = name
        self.message_class = message_class
        self._receive = receive
        self._receivers = receivers
        self._heard = False

    def take(self, message: Any) -> None:
        """Takes a message."""
        self._heard = True
        self._receive(message)

    def get_num_connections(self) -> int:
        """A recording holds no connections: a topic with a message counts as connected."""
        return int(self._heard)

    def unregister(self) -> None:
        """Ends the subscription."""
        self._receivers[self.resolved_name].remove(self)


STEP = 0.2  # s between two looks at what is shown, as when a robot is recorded
QUIET = 150.0  # s without a message, after which nothing changes any more
DISK = 60.0  # s
NO_LIMIT = 100_000_000  # events, and megabytes: nothing of a bag is forgotten


class RecordedModel(MonitorModel):
    """A model of which the caller is the only thread, but for the file's.

    :param file: of the history.
    :param clock: s since 1970.
    :param complain: takes a line about a message that cannot be shown.
    :param session: see :class:`.HistoryStore`.
    :raises HistoryError: the file cannot be used.
    """

    def __init__(
        self, file: Path, clock: Callable[[], float], complain: Callable[[str], None], session: str = ""
    ) -> None:
        history = HistoryStore(file, NO_LIMIT, megabytes=NO_LIMIT, clock=clock, session=session)
        super().__init__(DirectInbox(complain), history)

    def start(self) -> None:
        """Begins to record."""
        assert self.history is not None
        self.tree.set("meta", "run", self.history.run)
        self.history.follow(self.tree, live=False)

    def record(self) -> None:
        """Draws what waits to be drawn, and keeps what is shown now.

        :raises HistoryError: it cannot be written.
        """
        assert self.history is not None
        self._layouts.draw_waiting()
        self.history.take()
        if self.history.trouble:
            raise HistoryError(f"{self.history.path} cannot be written: {self.history.trouble}")

    def settle(self) -> None:
        """Waits until all of it is on the disk.

        :raises HistoryError: it cannot be written.
        """
        assert self.history is not None
        with contextlib.suppress(concurrent.futures.TimeoutError):
            self.history.runs().result(DISK)
        self.record()


def import_bag(
    recording: BagRecording,
    file: Path,
    progress: Callable[[float], object] = lambda part: None,
    complain: Callable[[str], None] = lambda line: print(line, file=sys.stderr),
) -> None:
    """Writes the history of a recording.

    :param recording: of `record:=true`.
    :param file: is made.
    :param progress: called again and again, with 0 to 1.
    :param complain: takes lines about what cannot be shown.
    :raises RecordingError: the bag is damaged.
    :raises HistoryError: the file cannot be used.
    """
    ros = RecordedSystem(recording)
    clock = ros.clock
    model = RecordedModel(file, ros.wall, complain)
    try:
        model.wording.sentences = sentences_of_node(ros, needed=False)
        board = PanelBoard(model, usable_panels(ros, complain), ros=ros)
        model.start()
        board.look()

        def show(wall: float) -> float:
            ros.go_to(wall)
            board.beat()
            model.record()
            progress((wall - clock.begin) / max(clock.end - clock.begin, STEP))
            return wall

        shown = clock.begin
        for message in recording.messages():
            wall, heard = clock.wall(message.at.to_sec()), shown
            while wall - shown >= STEP:
                shown = show(wall if shown - heard > QUIET else shown + STEP)
            ros.deliver(message)
        model.tree.set("meta", "time", recording.end)  # also when nothing else changes any more
        show(max(shown, clock.end))
        model.settle()
    finally:
        model.stop()


def usable_panels(ros: RosSystem, complain: Callable[[str], None]) -> List[str]:
    """The panels of applications that the monitor of then had, without those that are not here."""
    found: List[str] = []
    offered = ros.parameter(OFFERED, {})
    for path in dict.fromkeys([*ros.parameter("~panels", []), *offered.values()]):
        try:
            script_of(foreign_panel(str(path)))
        except ParameterError as error:
            complain(f"a panel is left out: {error}")
        else:
            found.append(str(path))
    return found

# SPDX-License-Identifier: Apache-2.0
"""The ROS system that panels follow; where a recording is opened, that of its bag stands for it."""

import threading
import time
from typing import Any, Callable, Dict, List, Mapping, NamedTuple, Optional

import rospy
import rospy.rostime
import tf2_ros

from merlin_monitor.history.history_file import WallClock
from merlin_ros.alarms import TickClock
from merlin_ros.master.master_link import ERRORS, bounded_master
from merlin_ros.master.namesake import living_namesake

TRANSFORMS_KEPT = 5.0  # s
STANDS = 0.5  # s of wall time without another ROS time, from when on a recording counts as paused
LONGEST_LOOK = 1.0  # s of silence that one look may count; the panels are checked twice per second
LEAST_JUMP = 0.05  # s; what is less is not a clock that was set


class TopicGraph(NamedTuple):
    """What is published.

    :ivar publishers: nodes, by topic.
    :ivar types: by topic.
    """

    publishers: Dict[str, List[str]]
    types: Dict[str, str]


class RosSystem:
    """What panels ask of ROS, asked in the node that they live in.

    All durations that are shown are differences of `time` and `time_of`, which continue evenly when the
    computer's clock is set.
    """

    _steady = WallClock()  # one of the process: times of two systems may be compared
    _publishers: Mapping[str, List[str]] = {}  # replaced as a whole, never changed
    _looking = threading.Lock()  # guards the field below
    _silence: Optional[TickClock] = None

    @property
    def namespace(self) -> str:
        """Namespace of the robot, with a slash at its end."""
        return str(rospy.get_namespace()).rstrip("/") + "/"

    @property
    def name(self) -> str:
        """Global name of the node."""
        return str(rospy.get_name())

    def resolve(self, name: str) -> str:
        """The global name of a relative one."""
        return str(rospy.resolve_name(name))

    def parameter(self, name: str, default: Any) -> Any:
        """The value of a parameter, or the default."""
        return rospy.get_param(name, default)

    def clock_set(self) -> float:
        """By how many s the computer's clock was set since the node began; 0 in a simulation."""
        jump = time.time() - self._steady() if rospy.rostime.is_wallclock() else 0.0
        return jump if abs(jump) >= LEAST_JUMP else 0.0

    def time(self) -> float:
        """ROS time, s; without what the clock was set by."""
        return float(rospy.get_time()) - self.clock_set()

    def time_of(self, message: Any) -> float:
        """When a message was sent, s of `time`: as its header says, else now."""
        stamp = message.header.stamp.to_sec() if message._has_header else 0.0
        jump = self.clock_set()
        if not stamp:
            return self.time()
        # One that was on its way while the clock was put back seems to come from the future.
        return min(stamp - jump, self.time()) if jump else stamp

    def wall(self) -> float:
        """s that continue at any time, and never back."""
        return time.monotonic()

    def silence_clock(self) -> float:
        """s in which silence is counted: as `wall`, without what this process has missed.

        They stand while a played recording stands.
        """
        with self._looking:
            if self._silence is None:
                self._silence = TickClock(self.wall, LONGEST_LOOK)
                self._silence.now = self.wall()
            self._silence.look()
            return self._silence.now

    def subscribe(
        self, topic: str, message_class: type, receive: Callable[[Any], object], **options: Any
    ) -> Any:
        """A subscriber, as rospy's.

        :param receive: called with each message.
        :param options: of rospy.
        """
        return rospy.Subscriber(topic, message_class, receive, **options)

    def publisher(self, topic: str, message_class: type) -> Any:
        """A publisher, as rospy's."""
        return rospy.Publisher(topic, message_class, queue_size=10)

    def transforms(self) -> Callable[[str, str], Any]:
        """Follows /tf. The function gives the newest transform into the first frame from the second one.

        It raises tf2_ros.TransformException when there is none.
        """
        buffer = tf2_ros.Buffer(rospy.Duration(TRANSFORMS_KEPT))
        listener = tf2_ros.TransformListener(buffer)

        def newest(target: str, source: str, kept: Any = listener) -> Any:
            return buffer.lookup_transform(target, source, rospy.Time(0))

        return newest

    def graph(self) -> Optional[TopicGraph]:
        """What is published; None: the master does not answer, or is new and does not know this node yet."""
        try:
            master = bounded_master()
            publishers = {topic: nodes for topic, nodes in master.getSystemState()[0] if nodes}
            types = {topic: kind for topic, kind in master.getTopicTypes() if topic in publishers}
        except ERRORS:
            return None
        if not any(self.name in nodes for nodes in publishers.values()):
            return None
        return TopicGraph(publishers, types)

    def look(self) -> Optional[Dict[str, str]]:
        """Asks what is published; returns the types by topic. None: no answer, what was known stays."""
        graph = self.graph()
        if graph is None:
            return None
        self._publishers = graph.publishers
        return graph.types

    def publisher_of(self, topic: str) -> str:
        """The first node that publishes a topic, as it was known at the last look; empty when none."""
        return next(iter(self.publishers_of(topic)), "")

    def publishers_of(self, topic: str) -> List[str]:
        """All nodes that publish a topic, as they were known at the last look."""
        return list(self._publishers.get(topic, []))

    def hangs(self, node: str) -> bool:
        """Whether a node takes connections and answers none; it may take 2 s to know.

        :param node: its global name.
        """
        try:
            found = living_namesake(node, bounded_master())
        except ERRORS:
            return False
        return found is not None and not found.process

    def address_of(self, service: str) -> str:
        """Where a service is served, empty when nowhere; a new address means a new process."""
        try:
            return str(bounded_master().lookupService(service))
        except ERRORS:
            return ""


class ReplayedSystem(RosSystem):
    """A recording that is played: nothing is silent because it is paused, or at its end."""

    def __init__(self) -> None:
        self._lock = threading.Lock()  # guards the fields below
        self._played, self._looked, self._counted = rospy.get_time(), self.wall(), 0.0

    def silence_clock(self) -> float:
        """s for which it was played; all but the first `STANDS` of a pause do not count."""
        with self._lock:
            played, now = rospy.get_time(), self.wall()
            if played != self._played:
                self._counted += min(now - self._looked, STANDS)
                self._played, self._looked = played, now
            return self._counted

    def graph(self) -> Optional[TopicGraph]:
        """What is published, without nodes: its player has the name of one of those that were recorded."""
        graph = super().graph()
        return graph and TopicGraph({}, graph.types)

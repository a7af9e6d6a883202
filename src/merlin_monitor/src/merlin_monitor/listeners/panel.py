# SPDX-License-Identifier: Apache-2.0
"""What a panel is: the base class of those in ``merlin_monitor.panels`` and of those of applications."""

import re
from typing import Any, Callable, ClassVar, Dict, List, Mapping, Optional, Set, Union

from merlin_monitor.listeners.ros_system import RosSystem
from merlin_monitor.state.freshness import Source
from merlin_monitor.state.history_events import sentence
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_monitor.text.phrase import Phrase
from merlin_ros.robot_values import ROBOTS

Request = Callable[[Dict[str, Any], str], str]


class Panel:
    """A panel of the page: follows topics, and keeps the section of the state that has its name.

    It is made when the monitor begins, and follows its topics from then on. What arrives is taken in by one
    thread after the other, so that a panel needs no locks.

    :param state: the model.
    :param ros: topics, parameters and times; a recording that is opened has its own.
    """

    name: ClassVar[str] = ""
    """Name of its section of the state, its element in the page, and its script."""
    title: ClassVar[str] = ""
    """Its heading; empty: it has no heading, and no link leads to it."""
    place: ClassVar[int] = 50
    """Panels stand in the order of their places."""
    width: ClassVar[int] = 12
    """Columns of 12 on a wide screen."""
    script: ClassVar[str] = ""
    """Its script as ``package://<package>/<path>``; empty: ``web/panels/<name>.js`` of merlin_monitor."""

    def __init__(self, state: MonitorModel, ros: RosSystem) -> None:
        self.state = state
        self.ros = ros

    # --- what a panel may do when something happens ---------------------------------------------------------

    def start(self) -> None:
        """Called once when the monitor begins; subscribe here."""

    def look(self, topics: Dict[str, str]) -> None:
        """Once per second, in the watch's thread: the topics that are published, with their types."""

    def sample(self) -> None:
        """Four times per second, in the pulse's thread: for what has no messages of its own."""

    def check(self, at: float, wall: float) -> None:
        """Twice per second, in the model's thread: for what is silent.

        :param at: s of ROS time.
        :param wall: s of ``ros.silence_clock()``.
        """

    def source(self) -> Optional[Source]:
        """Where its news come from; when that is gone or hangs, the panel is grey. None: it is never grey."""
        return None

    def owners(self) -> Mapping[str, Source]:
        """Owners of what the headline says, of :mod:`merlin_monitor.truth.worst_truth`, while they matter."""
        return {}

    def requests(self) -> Mapping[str, Request]:
        """What operators may ask of it by ``control.ask``, by names that no other panel has.

        Each takes the fields and the name of the operator, and returns a sentence at once. A ValueError says
        why it cannot be done.
        """
        return {}

    # --- what it does with it -------------------------------------------------------------------------------

    def subscribe(self, topic: str, message_class: type, take: Callable[..., object], **options: Any) -> Any:
        """Follows a topic.

        :param take: called with each message and its time, s, in the model's thread; the time is that of the
            message's header, else the present.
        :param options: of the subscriber.
        """

        def receive(message: Any) -> None:
            self.state.inbox.put(take, message, self.ros.time_of(message))

        options = {"queue_size": 100, "tcp_nodelay": True, **options}
        return self.ros.subscribe(topic, message_class, receive, **options)

    def source_of(self, *subscribers: Any) -> Source:
        """A source that lives while one of these subscribers is connected."""
        connected = [each for each in subscribers if each.get_num_connections()]
        return Source(bool(connected), self.ros.publisher_of((connected or subscribers)[0].resolved_name))

    def set(self, *path_and_value: Any) -> bool:
        """``set("table", "3", value)`` puts a value into the section; whether that changed anything."""
        return self.state.tree.set(self.name, *path_and_value)

    def report(self, kind: str, text: Phrase, at: float) -> None:
        """Puts an event into the history.

        :param kind: one of :data:`merlin_monitor.state.history_events.KINDS`.
        :param text: a text, or a phrase of :mod:`merlin_monitor.text.phrase`, for more than one language.
        :param at: s of ROS time.
        """
        self.state.report(sentence(kind, text, at))

    @classmethod
    def described(cls) -> Dict[str, Union[str, int]]:
        """The fields of this panel that the page gets."""
        script = cls.script or f"package://merlin_monitor/web/panels/{cls.name}.js"
        return {"name": cls.name, "title": cls.title, "width": cls.width, "script": script}


#: Robots of one plan that can have topics: any node can name others.
_NAME = re.compile(r"[A-Za-z]\w*", re.ASCII)


class PlanRobots:
    """Follows the robots of ``robots:=`` from the begin, and others once their hosts are heard.

    :param follow: makes the subscribers of a robot; called in the watch's thread.
    :param forget: called in the model's thread with a robot that is forgotten.
    """

    def __init__(
        self,
        panel: Panel,
        follow: Callable[[str], List[Any]],
        forget: Callable[[str], object] = lambda robot: None,
    ) -> None:
        self._panel, self._follow, self._forget = panel, follow, forget
        self._own = panel.ros.namespace.strip("/")
        self._named = list(panel.ros.parameter(ROBOTS, []) or [])
        self._followed: Dict[str, List[Any]] = {}  # robot → subscribers; of the watch's thread
        self.look()

    def names(self) -> Set[str]:
        """The robots that can have topics, without the one in the namespace of the monitor."""
        names = [*map(str, self._named), *self._panel.state.tree.keys("robots", "robots")]
        return {name for name in names if name != self._own and _NAME.fullmatch(name)}

    def subscribers(self, topic: str) -> List[Any]:
        """Those of a topic below each robot that is followed."""
        followed = list(self._followed.items())
        return [each for name, made in followed for each in made if each.resolved_name == f"/{name}/{topic}"]

    def look(self) -> None:
        """Begins and ends to follow; once per second, in the watch's thread."""
        names = self.names()
        for robot in names - self._followed.keys():
            self._followed[robot] = self._follow(robot)
        for robot in self._followed.keys() - names:
            for subscriber in self._followed.pop(robot):
                subscriber.unregister()
            self._panel.state.inbox.put(self._forget, robot)

# SPDX-License-Identifier: Apache-2.0
"""Notices topics and services that appear and vanish. The master sends no events, so the watch polls it."""

import threading
from typing import Callable, Dict, List, Optional

import rospy

from merlin_monitor.listeners.ros_system import RosSystem
from merlin_ros.work.threads import start_thread

PERIOD = 1.0  # s of wall time


class GraphWatch:
    """Asks the master once per period which topics have publishers.

    :param look: called with the topics that have publishers (name → type), in the watch's thread.
    :param ros: that is asked; None: that of this node.
    """

    def __init__(self, look: Callable[[Dict[str, str]], None], ros: Optional[RosSystem] = None) -> None:
        self.ros = ros or RosSystem()
        self._look = look
        self._publishers: Dict[str, List[str]] = {}  # replaced as a whole, never changed
        self._stopped = threading.Event()

    def start(self) -> None:
        """Begins to ask."""
        rospy.on_shutdown(self.stop)
        start_thread("topic watch", self._work)

    def stop(self) -> None:
        """Ends the thread that asks the master."""
        self._stopped.set()

    def publisher_of(self, topic: str) -> str:
        """The first node that publishes a topic, as the master knew it at the last look; empty when none."""
        return next(iter(self.publishers_of(topic)), "")

    def publishers_of(self, topic: str) -> List[str]:
        """All nodes that publish a topic, as the master knew them at the last look."""
        return list(self._publishers.get(topic, []))

    def address_of(self, service: str) -> str:
        """Where a service is served, empty when nowhere; a new address means a new process."""
        return self.ros.address_of(service)

    def look(self) -> None:
        """Asks the master once. Without an answer what was known stays."""
        graph = self.ros.graph()
        if graph is not None:  # else what is known stays
            self._publishers = graph.publishers
            self._look(graph.types)

    def _work(self) -> None:
        while not self._stopped.is_set():
            try:
                self.look()
            except Exception as error:  # the master may be gone at any call; the next look sees
                if not rospy.is_shutdown():
                    rospy.logwarn_throttle(30.0, f"monitor: {type(error).__name__}: {error}")
            self._stopped.wait(PERIOD)

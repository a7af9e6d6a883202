# SPDX-License-Identifier: Apache-2.0
"""Checks what changes without an event: the time, a silent node, a small motion of the robot."""

import threading
from typing import Any, Callable, Dict, Mapping, Sequence

import rospy
from merlin_msgs.msg import SimStatus

from merlin_monitor.listeners.panel import Panel, sender_of
from merlin_monitor.listeners.ros_system import RosSystem
from merlin_monitor.state.freshness import Source
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_monitor.truth.worst_truth import SIMULATOR
from merlin_ros.deadline import SIM_STATUS_TOPIC
from merlin_ros.work.threads import start_thread

SAMPLES = 4.0  # per s of wall time
CHECKS = 0.5  # s of wall time between two looks at what is silent


class Pulse:
    """Calls the panels four times per second, and follows the simulator.

    :param state: the model.
    :param panels: sampled and checked.
    :param sources: of the sections, asked at each check, in the same thread.
    :param ros: has the times, and the simulator.
    """

    def __init__(
        self,
        state: MonitorModel,
        panels: Sequence[Panel],
        sources: Callable[[], Mapping[str, Source]],
        ros: RosSystem,
    ) -> None:
        self._state = state
        self._panels = panels
        self._sources = sources
        self._subscriber: Any = None
        self._node = ""  # of the simulator
        self._ros = ros
        self._checked = 0.0  # of the thread that beats
        self._stopped = threading.Event()
        if ros.parameter("/use_sim_time", False):  # elsewhere its topic says nothing
            self._subscriber = ros.subscribe(SIM_STATUS_TOPIC, SimStatus, self._simulator, queue_size=10)

    def start(self) -> None:
        """Starts the thread of the pulse."""
        rospy.on_shutdown(self.stop)
        start_thread("pulse", self._work)

    def stop(self) -> None:
        """Ends the thread of the pulse."""
        self._stopped.set()

    def _work(self) -> None:
        while not self._stopped.wait(1.0 / SAMPLES):
            try:
                self.beat()
            except Exception as error:  # a panel's mistake: without this thread the page is grey forever
                rospy.logwarn_throttle(30.0, f"monitor: {type(error).__name__}: {error}")

    def beat(self) -> None:
        """Samples, and checks when it is time for that."""
        for panel in self._panels:
            panel.sample()
        now = self._ros.wall()
        if now - self._checked >= CHECKS:
            self._checked = now
            self._state.tree.set("meta", "clock_set", round(self._ros.clock_set(), 1))
            times = self._ros.time(), self._ros.silence_clock(), now
            self._state.inbox.put(self._check, *times, self._sources(), self._all_owners())

    def _check(
        self,
        at: float,
        silence: float,
        now: float,
        sources: Mapping[str, Source],
        owners: Mapping[str, Source],
    ) -> None:
        self._state.tree.set("meta", "time", round(at, 1))
        for panel in self._panels:
            panel.check(at, silence)
        self._state.freshness.check(at, sources, owners)
        self._state.now.refresh()
        self._state.refresh_problems(silence)
        self._state.checked(now)

    def _all_owners(self) -> Dict[str, Source]:
        owners = {owner: source for panel in self._panels for owner, source in panel.owners().items()}
        if self._subscriber is not None:
            owners[SIMULATOR] = Source(bool(self._subscriber.get_num_connections()), self._node)
        return owners

    def _simulator(self, message: SimStatus) -> None:
        self._node = sender_of(message)
        factor = round(message.achieved_factor, 1)
        self._state.inbox.put(
            self._state.tree.set, "meta", "simulator", {"paused": message.paused, "factor": factor}
        )

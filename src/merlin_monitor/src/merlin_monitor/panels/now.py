# SPDX-License-Identifier: Apache-2.0
"""The panel of the present: what the mission and the Executor do, as the headline."""

from typing import Any, Dict, List, Tuple

from actionlib_msgs.msg import GoalID
from merlin_msgs.msg import ExecuteActionResult, ExecutorStatus, GoalQueue, MissionStatus

from merlin_monitor.listeners.panel import Panel
from merlin_monitor.listeners.ros_system import RosSystem
from merlin_monitor.state.freshness import Source
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_monitor.state.plan_section import OVERTAKEN
from merlin_monitor.truth.worst_truth import LIVE, MISSION
from merlin_ros.actions.peers import sender_of


class NowPanel(Panel):
    """What the robot does now, and why."""

    name, place = "now", 2

    def __init__(self, state: MonitorModel, ros: RosSystem) -> None:
        super().__init__(state, ros)
        executor = self.ros.parameter("~executor", "merlin/execute")
        # Results of requests that nothing has named yet: with their times, and s of wall time when they came.
        self._early: List[Tuple[Any, float, float]] = []
        self._status = self.subscribe("merlin/status", ExecutorStatus, state.now.executor)
        self._mission = self.subscribe("merlin/mission", MissionStatus, self._take_mission)
        self._others = [
            self.subscribe(f"{executor}/result", ExecuteActionResult, self._take_result),
            self.subscribe(f"{executor}/cancel", GoalID, self._cancel),
        ]

    def source(self) -> Source:
        """The Executor."""
        return self.source_of(self._status)

    def check(self, at: float, wall: float) -> None:
        """Takes in the results whose requests have been named since, or will not be."""
        early, self._early = self._early, []
        for result, ended, heard in early:
            if self.state.now.knows(result.status.goal_id.id) or wall - heard >= OVERTAKEN:
                self.state.now.result(result, ended)
            else:
                self._early.append((result, ended, heard))

    def owners(self) -> Dict[str, Source]:
        """The mission, while it goes on."""
        live = self.state.tree.get("now", "mission", "state") in LIVE
        return {MISSION: self.source_of(self._mission)} if live else {}

    def _take_result(self, message: ExecuteActionResult, at: float) -> None:
        wall = self.ros.silence_clock()
        self._early.append((message, at, wall))
        self.check(at, wall)

    def _take_mission(self, message: MissionStatus, at: float) -> None:
        self.state.now.mission(message, at, sender_of(message))

    def _cancel(self, message: GoalID, at: float) -> None:
        if sender_of(message) != self.ros.name:  # a cancel of ours has its operator's name in the history
            self.state.now.cancel(message, at, sender_of(message))


class QueuePanel(Panel):
    """The requests of the Executor."""

    name, title, place, width = "queue", "Queue", 36, 7

    def __init__(self, state: MonitorModel, ros: RosSystem) -> None:
        super().__init__(state, ros)
        self._queue = self.subscribe("merlin/queue", GoalQueue, state.now.queue)

    def source(self) -> Source:
        """The Executor."""
        return self.source_of(self._queue)


class HistoryPanel(Panel):
    """The events of the run."""

    name, title, place, width = "history", "History", 80, 5

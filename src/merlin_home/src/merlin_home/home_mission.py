# SPDX-License-Identifier: Apache-2.0
"""The mission of the home: the robot asks at each point of interest whether a service is needed."""

import rospy

from merlin_executor.mission import GoalDispatcher, MissionFailed
from merlin_home.mission_list import make_mission, mission_tasks


class HomeMission(GoalDispatcher):
    """Sends the tasks of a list; a marked one is cancelled if it still runs after some time.

    :param mission: 1, 2 or 3: 6, 20 or 120 tasks.
    :param tasks: length of the list; 0: that of the mission.
    :param seed: of the list.
    :param marked_share: share of marked tasks, 0 to 1.
    :param cancel_after: s of ROS time between sending and cancelling a marked task.
    :param points: points of interest to visit, separated by blanks; empty: all of the world.
    :raises ValueError: when no such list can be made.
    """

    servers = ("move_base", "sound_play")

    def __init__(
        self,
        mission: int = 1,
        tasks: int = 0,
        seed: int = 1,
        marked_share: float = 0.5,
        cancel_after: float = 10.0,
        points: str = "",
    ) -> None:
        if cancel_after < 0.1:
            raise ValueError(f"parameter ~cancel_after is {cancel_after:g}, less than 0.1")
        names = points.split() or list(rospy.get_param("world/points_of_interest", {}))
        self._tasks = make_mission(names, tasks or mission_tasks(mission), seed, marked_share)
        self._cancel_after = cancel_after
        super().__init__("home mission", len(self._tasks))

    def run(self) -> None:
        """Sends one task after the other.

        :raises MissionFailed: when a task ends otherwise than the list says.
        """
        for task in self._tasks:
            self.remove_facts(f"(checked {task.poi})")
            try:
                self.achieve(f"(checked {task.poi})", self._cancel_after if task.marked else None)
            except MissionFailed as error:
                if self.cancelled or not task.marked or not error.was_cancelled:
                    raise

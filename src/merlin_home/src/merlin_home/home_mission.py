"""The mission of the home: to ask at one point of interest after the other whether a service is needed."""

from typing import Sequence

from merlin_msgs.msg import ExecuteResult

from merlin_executor.goal_dispatcher import GoalDispatcher, MissionFailed
from merlin_home.mission_list import MissionTask


class HomeMission(GoalDispatcher):
    """Sends the tasks of a list; a marked one is cancelled if it still runs after some time.

    :param tasks: the list.
    :param cancel_after: s of running time between sending and cancelling a marked task.
    """

    def __init__(self, tasks: Sequence[MissionTask], cancel_after: float) -> None:
        super().__init__("home mission", len(tasks))
        self._tasks = tasks
        self._cancel_after = cancel_after

    def run(self) -> None:
        """Sends one task after the other.

        :raises MissionFailed: when a task ends otherwise than the list says.
        """
        for task in self._tasks:
            self.remove_facts(f"(checked {task.poi})")
            try:
                self.achieve(f"(checked {task.poi})", self._cancel_after if task.marked else None)
            except MissionFailed as error:
                if self._cancelled or not task.marked or not _was_cancelled(error):
                    raise


def _was_cancelled(error: MissionFailed) -> bool:
    return error.result is not None and error.result.outcome == ExecuteResult.CANCELLED

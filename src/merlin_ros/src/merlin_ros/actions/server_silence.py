# SPDX-License-Identifier: Apache-2.0
"""Which goals of a client its server no longer answers. Pure: the client's own time and statuses go in.

Silence counts in the client's own ticks (:mod:`merlin_ros.alarms`). Messages of one connection come in
order: while the server, or the client itself, works off what was sent before, what comes behind is not late.
A server that has hung may say its status before it has read what came meanwhile.
"""

from typing import Callable, Iterable, List, Mapping, Optional, Tuple

from actionlib_msgs.msg import GoalStatus

from merlin_ros.actions.client_goal import TERMINAL, ClientGoal
from merlin_ros.alarms import TickClock

SILENCE = 3.0  # s of running time without status after which a server that is not connected counts as dead
CONNECTED_SILENCE = 7.0  # s of that after which one counts as dead that is
GONE_SILENCE = 1.0  # s of that after which one counts as dead whose process has closed its connection
LATE_RESULT = 3.0  # s that a result may come behind the status that announces it
HUNG = 2.0  # s between two statuses from which the server has hung
LOOK = 0.25  # s between two looks of the client; one look counts at most twice as much


class ServerSilence:
    """Counts how long a server has been silent, for all goals of a client. Not thread-safe.

    :param action: its name.
    :param clock: running time, s.
    """

    def __init__(self, action: str, clock: Callable[[], float]) -> None:
        self._action = action
        self._ticks = TickClock(clock, 2.0 * LOOK)
        self._heard: Optional[float] = None
        self._settled: Optional[Tuple[float, float]] = None  # last result: its status came, it came itself

    def look(self) -> float:
        """The client's own time, s."""
        self._ticks.look()
        return self._ticks.now

    def hear(self, statuses: Mapping[str, GoalStatus], goals: Iterable[ClientGoal]) -> List[ClientGoal]:
        """A status list has come.

        :param statuses: by goal id.
        :param goals: of the client, in the order in which they were sent.
        :return: goals that the server knew and no longer names.
        """
        before, now = self._heard, self.look()
        self._heard = now
        forgotten: List[ClientGoal] = []
        busy = before is not None and now - before > HUNG  # with what was sent before
        for goal in goals:
            status = statuses.get(goal.id)
            if status is not None and not _is_earlier(status, goal):
                busy = busy or not goal.seen
                goal.seen = True
                if status.status not in TERMINAL:
                    goal.heard(status.status, status.text)
                elif goal.ended_on_server is None:
                    goal.ended_on_server = now
                    goal.text = status.text
            elif goal.seen and goal.ended_on_server is None:
                forgotten.append(goal)
            elif busy:
                goal.turn = now
        return forgotten

    def settle(self, goal: ClientGoal) -> None:
        """The result of a goal has come."""
        if goal.ended_on_server is not None:
            self._settled = goal.ended_on_server, self.look()

    def part(self, goals: Iterable[ClientGoal]) -> None:
        """No server is connected, if one ever was."""
        if self._heard is not None:
            for goal in goals:
                goal.alone = self._ticks.now

    def silent(self, goal: ClientGoal) -> float:
        """How long the server has said nothing, s, at most since a goal was sent."""
        return self._ticks.now - max(self._heard or 0.0, goal.sent)

    def why_lost(self, goal: ClientGoal, publishes: bool, connected: bool) -> str:
        """Why the server will not answer a goal any more; empty: it still may.

        :param publishes: whether a connection for its status is open.
        :param connected: whether all connections to it are open.
        """
        now, heard = self._ticks.now, self._heard or 0.0
        silent = self.silent(goal)
        if silent > GONE_SILENCE and self._heard is not None and not publishes:
            return f"the process of the action server {self._action} is gone"
        if silent > (CONNECTED_SILENCE if connected else SILENCE):
            return f"the action server {self._action} has been silent for {silent:.1f} s"
        if goal.alone is None:
            since, patience = goal.turn, SILENCE
        else:  # what answers now is another process than the one that it was sent to
            since, patience = goal.alone, GONE_SILENCE
        if not goal.seen and heard - since > patience:
            return f"the action server {self._action} never acknowledged the goal"
        if goal.ended_on_server is not None and now - self._results_since(goal.ended_on_server) > LATE_RESULT:
            return f"the action server {self._action} ended the goal without a result: {goal.text}"
        return ""

    def _results_since(self, ended: float) -> float:
        """When the last result came that may come before the one of a goal that ended then."""
        if self._settled is None or self._settled[0] > ended:
            return ended
        return max(ended, self._settled[1])


def _is_earlier(status: GoalStatus, goal: ClientGoal) -> bool:
    """Whether that is a lasting goal that ended before this one was sent under its id."""
    older = status.goal_id.stamp < goal.goal_id.stamp
    return bool(goal.lasting and not goal.seen and status.status in TERMINAL and older)

# SPDX-License-Identifier: Apache-2.0
"""MerlinAction: the bridge between a plan dispatcher and an action's state machine (paper, section 3.2.3)."""

import threading
from typing import Any, Dict, Optional, Tuple

import rospy
from merlin_msgs.msg import RunActionGoal

from merlin_actions.action_interface import ActionInterface
from merlin_actions.action_servers import ActionServers
from merlin_actions.core.ending import Ending, MachineEnd, ending_of, no_retry
from merlin_actions.core.execution import Execution, Key
from merlin_actions.core.robot_book import RobotChange
from merlin_actions.robot_watch import RobotWatch
from merlin_actions.stopped_robots import EffectsOfDrives, StoppedRobots
from merlin_planning.dispatch_progress import INTERRUPTIBLE, NO, YES
from merlin_ros.actions.action_client import ActionClient
from merlin_ros.actions.client_goal import ClientGoal
from merlin_ros.deadline import limit
from merlin_ros.health import Health
from merlin_ros.ros_alarm import RosStopwatch
from merlin_ros.work.goal_end import GoalEnd


class MerlinAction(ActionInterface):
    """Runs an operator on the action server ``actions/<name>``; a cancel reaches the machine while it runs.

    :param server_wait: s of running time to wait for the action server; zero or less: it has to be there.
    :param cancel_limit: s of running time in which the machine has to stop; zero or less: no limit.
    :param run_limit: s of ROS time in which it has to end; zero or less: no limit.
    :param robots: where an action with a parameter of type ``robot`` runs on that robot; None: all run here.
    :param stopped: where robots stand whose drives were stopped; None: it is not followed.

    Further parameters are those of :class:`ActionInterface`.
    """

    def __init__(
        self,
        operator: str,
        server_wait: float = 4.0,
        cancel_limit: float = 3.5,
        run_limit: float = 1800.0,
        robots: Optional[RobotWatch] = None,
        stopped: Optional[StoppedRobots] = None,
        **options: Any,
    ) -> None:
        super().__init__(operator, **options)
        if stopped is not None:
            self._effects = EffectsOfDrives(self._effects, stopped)
        self._server_wait = server_wait
        self._cancel_limit = cancel_limit
        self._run_limit = run_limit
        self._servers = ActionServers(self.formula, self.knowledge.types() if robots else {}, robots)
        self._sent: Dict[Key, Tuple[ActionClient, ClientGoal]] = {}  # guarded by _changed

    def health(self) -> Health:
        """Whether the action servers answer."""
        return self._servers.health()

    def ready(self, execution: Execution) -> Optional[Ending]:
        """Waits for the action server: before, the declared facts may be those of an earlier server."""
        robot = execution.lane
        if robot:
            robots = self._servers.robots
            execution.interruptible(robots.wake)
            why = robots.wait(robot, self._server_wait, execution.cancelled.is_set)
            execution.interruptible(None)
            if why:
                return Ending(False, why, begun=False, robot=robot)
        client = self._servers.client(robot)
        if not client.wait_for_server(self._server_wait, execution.cancelled.is_set):
            if execution.cancelled.is_set():
                return Ending(False, execution.cancel_reason, begun=False)
            reason = f"no action server {client.name} within {self._server_wait:g} s ({client.missing})"
            return Ending(False, reason, begun=False)
        return None

    def run(self, execution: Execution) -> Ending:
        """Sends the goal and waits for the machine's end."""
        client = self._servers.client(execution.lane)
        ended = threading.Event()
        sent = client.send(
            RunActionGoal(
                parameters=execution.parameters,
                action_id=execution.dispatch.action_id,
                plan_id=execution.dispatch.plan_id,
                duration=execution.dispatch.duration,
            ),
            on_done=lambda _: ended.set(),
            on_feedback=lambda _, feedback: self._tell_state(execution, feedback.uninterruptible),
            owner=execution.token,
        )

        def cancel() -> None:
            sent.cancel()
            ended.set()

        with self._changed:
            self._sent[execution.key] = client, sent
        execution.interruptible(cancel)
        if execution.lost:
            client.give_up(sent, execution.lost)
        try:
            return self._end_of(execution, client, sent, ended)
        finally:
            with self._changed:
                del self._sent[execution.key]

    def _tell_state(self, execution: Execution, uninterruptible: bool) -> None:
        """Tells the Executor whether a more urgent request has to wait for another state of the machine."""
        if uninterruptible != execution.uninterruptible and not execution.answered:
            execution.uninterruptible = uninterruptible
            self._answer(execution.key, None, **{INTERRUPTIBLE: NO if uninterruptible else YES})

    def _end_of(
        self, execution: Execution, client: ActionClient, sent: ClientGoal, ended: threading.Event
    ) -> Ending:
        late = self._wait(ended)
        if late:
            sent.cancel()
        if not sent.done and not sent.wait(limit(self._cancel_limit)):
            what = f"still runs after {self._run_limit:g} s" if late else "was cancelled"
            client.give_up(sent, "it did not stop in time")
            return Ending(
                False,
                f"{execution.text} {what}, and {client.name} does not stop ({self._cancel_limit:g} s)",
                unstopped=client.name,
            )
        if late and sent.status != GoalEnd.SUCCEEDED:
            reason = f"{execution.text} did not end within {self._run_limit:g} s and was stopped"
            return Ending(False, reason, unstopped=_result_of(sent).unstopped)
        if sent.status == GoalEnd.LOST and execution.lane and not execution.lost:
            self._servers.robots.suspect(execution.lane, sent.text)
        return ending_of(GoalEnd(sent.status), _result_of(sent), execution, sent.text)

    def _wait(self, ended: threading.Event) -> bool:
        """Waits for the end or a cancel; True when the run limit passed."""
        passed = RosStopwatch()
        while not ended.wait(1.0):
            if rospy.is_shutdown():
                return False
            if 0.0 < self._run_limit < passed.look():
                return True
        return False

    def _lane(self, execution: Execution) -> str:
        """The robot that runs it; empty: it needs none."""
        return self._servers.robot(execution.binding)

    def _param(self, execution: Execution) -> str:
        return self._servers.param(execution.lane)

    def _of_robot(self, execution: Execution, ending: Ending) -> Ending:
        """What an end says when its robot no longer takes actions."""
        robot = execution.lane
        if not robot or ending.succeeded or ending.robot:
            return ending
        cancelled, why = execution.cancelled.is_set(), execution.lost or self._servers.robots.why_not(robot)
        if why and (execution.lost or not cancelled or execution.cancel_reason == why):
            return ending._replace(reason=why, robot=robot, of_robot="")
        if cancelled:
            return ending
        arguments = [parameter.value for parameter in execution.parameters]
        return ending._replace(of_robot=no_retry(execution.dispatch.name, arguments, robot))

    def _run_with_effects(self, execution: Execution) -> Ending:
        ending = self._of_robot(execution, super()._run_with_effects(execution))
        if ending.robot:  # the next plan is made as soon as the dispatcher knows
            self._servers.robots.wait_published(ending.robot)
        return ending

    def _answer_end(self, execution: Execution, ending: Ending) -> None:
        ending = self._of_robot(execution, ending)
        if ending.robot:  # the robot may have left since
            self._servers.robots.wait_published(ending.robot)
        super()._answer_end(execution, ending)

    def robot_changed(self, change: RobotChange) -> None:
        """A robot takes actions, or no longer takes actions: then its running actions fail."""
        if change.available:
            if self._servers.parameter:
                self._servers.client(change.robot)  # connects meanwhile
            return
        for execution in self.executions():
            # The knowledge may say that the robot is back before this is read, and the next plan begins.
            if execution.lane != change.robot or execution.arrived > change.at:
                continue
            if not change.answers:
                execution.lost = change.reason
            self._cancel(execution, change.reason)
            with self._changed:
                client, sent = self._sent.get(execution.key, (None, None))
            if execution.lost and client is not None and sent is not None:
                client.give_up(sent, change.reason)
        if change.forgotten:
            self._servers.forget(change.robot)


def _result_of(sent: ClientGoal) -> MachineEnd:
    """The result of a goal; a lost one has none."""
    return MachineEnd(*(str(getattr(sent.result, name, "")) for name in MachineEnd._fields))

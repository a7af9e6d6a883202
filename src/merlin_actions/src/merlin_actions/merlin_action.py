"""MerlinAction: the bridge between a plan dispatcher and an action's state machine (paper, section 3.2.3)."""

import threading
from typing import Any, Optional

import rospy
from actionlib_msgs.msg import GoalStatus
from merlin_msgs.msg import DispatchStatus, RunActionAction, RunActionGoal
from rosplan_dispatch_msgs.msg import ActionDispatch

from merlin_actions.action_interface import ActionInterface
from merlin_actions.core.ending import Ending
from merlin_actions.core.execution import Execution
from merlin_actions.core.machine_end import GoalEnd, MachineEnd, ending_of
from merlin_actions.core.names import ros_name
from merlin_ros.actions.action_client import ActionClient, ClientGoal
from merlin_ros.deadline import limit
from merlin_ros.health import ERROR, Health

_HOW = {
    GoalStatus.SUCCEEDED: GoalEnd.SUCCEEDED,
    GoalStatus.PREEMPTED: GoalEnd.PREEMPTED,
    GoalStatus.RECALLED: GoalEnd.RECALLED,
    GoalStatus.REJECTED: GoalEnd.REJECTED,
    GoalStatus.LOST: GoalEnd.LOST,
}


class MerlinAction(ActionInterface):
    """Runs an operator on the action server ``actions/<name>``; a cancel reaches the machine while it runs.

    :param server_wait: s of running time to wait for the action server; zero or less: it has to be there.
    :param cancel_limit: s of running time in which the machine has to stop; zero or less: no limit.
    :param run_limit: s of ROS time in which it has to end; zero or less: no limit.

    Further parameters are those of :class:`ActionInterface`.
    """

    def __init__(
        self,
        operator: str,
        server_wait: float = 4.0,
        cancel_limit: float = 3.5,
        run_limit: float = 1800.0,
        **options: Any,
    ) -> None:
        super().__init__(operator, **options)
        self._server_wait = server_wait
        self._cancel_limit = cancel_limit
        self._run_limit = run_limit
        self._client = ActionClient(f"actions/{ros_name(operator)}", RunActionAction)

    def health(self) -> Health:
        """Whether the action server answers."""
        if self._client.alive:
            return Health()
        return Health(ERROR, f"no action server {self._client.name}; does the host of its machine run?")

    def ready(self, execution: Execution) -> Optional[Ending]:
        """Waits for the action server: until it is there, the declared facts may be an earlier one's."""
        if not self._client.wait_for_server(self._server_wait, execution.cancelled.is_set):
            if execution.cancelled.is_set():
                return Ending(False, execution.cancel_reason, begun=False)
            missing = self._client.missing
            reason = f"no action server {self._client.name} within {self._server_wait:g} s ({missing})"
            return Ending(False, reason, begun=False)
        return None

    def run(self, execution: Execution) -> Ending:
        """Sends the goal and waits for the machine's end."""
        ended = threading.Event()
        sent = self._client.send(
            RunActionGoal(
                parameters=execution.parameters,
                action_id=execution.dispatch.action_id,
                plan_id=execution.dispatch.plan_id,
                duration=execution.dispatch.duration,
            ),
            on_done=lambda _: ended.set(),
            owner=execution.token,
        )

        def cancel() -> None:
            sent.cancel()
            ended.set()

        execution.interruptible(cancel)
        late = self._wait(ended)
        if late:
            sent.cancel()
        if not sent.done and not sent.wait(limit(self._cancel_limit)):
            what = f"still runs after {self._run_limit:g} s" if late else "was cancelled"
            self._client.give_up(sent, "it did not stop in time")
            return Ending(
                False,
                f"{execution.text} {what}, and {self._client.name} does not stop ({self._cancel_limit:g} s)",
                unstopped=self._client.name,
            )
        if late and sent.status != GoalStatus.SUCCEEDED:
            reason = f"{execution.text} did not end within {self._run_limit:g} s and was stopped"
            return Ending(False, reason, unstopped=_end_of(sent).unstopped)
        return ending_of(_HOW.get(sent.status, GoalEnd.ABORTED), _end_of(sent), execution, sent.text)

    def _wait(self, ended: threading.Event) -> bool:
        """Waits for the end or a cancel; True when the run limit passed."""
        longest = rospy.Duration(self._run_limit) if self._run_limit > 0 else None
        begin = rospy.Time.now()
        while not ended.wait(1.0):
            if rospy.is_shutdown():
                return False
            if longest is not None and rospy.Time.now() - begin > longest:
                return True
        return False

    def start(self) -> None:
        """See :meth:`ActionInterface.start`."""
        self._running: frozenset = frozenset()
        rospy.Subscriber(
            f"{self._dispatcher}/dispatch_status", DispatchStatus, self._note_dispatcher, tcp_nodelay=True
        )
        super().start()

    def _note_dispatcher(self, status: DispatchStatus) -> None:
        self._running = frozenset((action.plan_id, action.action_id) for action in status.running)

    def _expected(self, dispatch: ActionDispatch) -> bool:
        return (dispatch.plan_id, dispatch.action_id) in self._running


def _end_of(sent: ClientGoal) -> MachineEnd:
    """The result of a goal; a lost one has none."""
    return MachineEnd(*(str(getattr(sent.result, name, "")) for name in MachineEnd._fields))

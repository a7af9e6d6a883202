"""A dispatcher of MERLIN, as a client deals with it: by goals and its status."""

from typing import Callable, List, Optional, Sequence

from merlin_msgs.msg import DispatchStatus
from rosplan_dispatch_msgs.msg import ActionDispatch, NonBlockingDispatchGoal

from merlin_planning.dispatch_progress import Action, DispatchProgress, DispatchResult, Reply
from merlin_planning.dispatcher_kind import DispatcherKind, Hold
from merlin_ros.actions.action_client import ActionClient
from merlin_ros.actions.client_goal import ClientGoal

SERVER_WAIT = 2.0  # s of running time for the connection to a dispatcher's action server to be complete


class ReportingDispatcher(DispatcherKind):
    """A dispatcher that publishes its status, as those of MERLIN do.

    Its plan is a goal of ``dispatch_plan_action``, which the client leases.

    :param server: the client of that action.
    """

    reports = True
    stops_after_failure = True

    def __init__(self, server: ActionClient) -> None:
        self._server = server
        self._goal: Optional[ClientGoal] = None  # of the present dispatch, written by its thread
        self._status, self._is_new = DispatchStatus(), False

    def receive(self, status: DispatchStatus) -> None:
        """Keeps the status that the dispatcher has published last."""
        self._status, self._is_new = status, True
        self.hold = Hold(status.held, tuple(status.breakpoints))

    def begin(self, plan: Sequence[ActionDispatch]) -> DispatchProgress:
        """The present status is of before."""
        self._is_new = False
        return DispatchProgress()

    def wait(self, plan: Sequence[ActionDispatch], interrupted: Callable[[], bool]) -> str:
        """For the connection to its action server."""
        there = self._server.wait_for_server(SERVER_WAIT, interrupted)
        return "" if there else self._server.missing

    def send(self, ended: Callable[[object], None], owner: Optional[str]) -> None:
        """A goal, which is leased."""
        self._goal = self._server.send(NonBlockingDispatchGoal(), ended, owner=owner)

    def cancel(self) -> None:
        """Names the goal."""
        if self._goal is not None:
            self._goal.cancel()

    def end(self, hangs: bool) -> None:
        """A goal that has no answer is given up."""
        goal, self._goal = self._goal, None
        if hangs and goal is not None:
            self._server.give_up(goal, "its dispatch does not end")

    @property
    def busy(self) -> bool:
        """True unless the status says idle."""
        return bool(self._status.state != DispatchStatus.IDLE)

    @property
    def failed_action(self) -> str:
        """As the last status says."""
        return str(self._status.failed_action) if self._is_new else ""

    @property
    def at_rest(self) -> bool:
        """True after a status of this dispatch that says idle."""
        return self._is_new and not self.busy

    def started(self, progress: DispatchProgress) -> bool:
        """True when the status says so, or there is a goal to be named."""
        return self.busy or self._goal is not None

    def failure_grace(self, slack: Optional[float]) -> Optional[float]:
        """Our dispatcher stops the other actions itself, within its own deadline."""
        return slack

    def to_cancel(self, progress: DispatchProgress) -> List[Action]:
        """None: it passes a cancel on."""
        return []

    def result(self, progress: DispatchProgress, reply: Reply) -> DispatchResult:
        """With what the status says of the failure."""
        if not self._is_new:
            return progress.result(reply)
        status = self._status
        return progress.result(reply, status.failed_action, status.reason, status.unmet_goals)

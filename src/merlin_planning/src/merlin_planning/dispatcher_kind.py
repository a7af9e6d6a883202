# SPDX-License-Identifier: Apache-2.0
"""What differs between dispatchers: ours publish a status, ROSPlan's own (:mod:`.over_rosplan`) do not."""

from abc import ABC, abstractmethod
from typing import Callable, NamedTuple, Optional, Sequence, Tuple

from merlin_msgs.msg import DispatchStatus
from rosplan_dispatch_msgs.msg import ActionDispatch, NonBlockingDispatchGoal

from merlin_planning.dispatch_progress import Action, DispatchProgress, DispatchResult, Reply
from merlin_ros.actions.action_client import ActionClient
from merlin_ros.actions.client_goal import ClientGoal

SERVER_WAIT = 2.0  # s of running time for the connection to a dispatcher's action server to be complete


class Hold(NamedTuple):
    """Where a dispatcher is held by an operator's wish."""

    held: str = ""
    """The action before which it is held now, as PDDL text; empty: it is not."""
    breakpoints: Tuple[str, ...] = ()
    """Actions before which it will be, with ``*`` for any argument."""


class DispatcherKind(ABC):
    """How a dispatcher is dealt with. Its client holds its own lock, but not where something may block."""

    reports = False
    """It publishes its status, and stops the other actions by itself when one fails."""

    @abstractmethod
    def begin(self, plan: Sequence[ActionDispatch]) -> DispatchProgress:
        """A dispatch begins; returns its book."""

    @abstractmethod
    def wait(self, plan: Sequence[ActionDispatch], interrupted: Callable[[], bool]) -> str:
        """Waits, with a limit, until the dispatcher can be given the plan. Blocks.

        :param interrupted: ends the wait.
        :return: what is missing; empty: it may be sent.
        """

    def dispatched(self, action_id: int, send: Callable[[], object]) -> None:  # noqa: B027 - most need not know
        """An action of the present dispatch was seen.

        :param send: sends it once more, for a dispatcher that does not by itself.
        """

    @abstractmethod
    def send(self, ended: Callable[[object], None], owner: Optional[str]) -> None:
        """Gives it the plan.

        :param ended: called, from another thread, with the dispatcher's answer or what the call has raised.
        :param owner: id of the goal of this process's own server on whose behalf it is dispatched.
        """

    @abstractmethod
    def cancel(self, progress: DispatchProgress) -> Sequence[Action]:
        """Sends the cancel of the dispatch. May block.

        :return: the actions to which its client has to pass it on.
        """

    @abstractmethod
    def end(self, hangs: bool) -> None:
        """The dispatch is over for its client.

        :param hangs: whether the dispatcher has not answered.
        """

    @abstractmethod
    def started(self, progress: DispatchProgress) -> bool:
        """True when the dispatcher is known to have begun the dispatch: a cancel before would be lost."""

    def goal(self, owner: Optional[str] = None) -> str:
        """Id of the goal that is the present dispatch; empty: it is none.

        :param owner: id of the goal on whose behalf it runs from now on; None: as before.
        """
        return ""

    def failure_grace(self, slack: Optional[float]) -> Optional[float]:
        """Time for it to end after an action failed, s of running time; None: no limit.

        :param slack: the time that it gets after a cancel.
        """
        return slack

    def result(self, progress: DispatchProgress, reply: Reply) -> DispatchResult:
        """How the dispatch ended."""
        return progress.result(reply)


class ReportingDispatcher(DispatcherKind):
    """A dispatcher that publishes its status, as those of MERLIN do.

    Its plan is a goal of ``dispatch_plan_action``, which the client leases.

    :param server: the client of that action.
    """

    reports = True
    hold = Hold()

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

    def cancel(self, progress: DispatchProgress) -> Sequence[Action]:
        """Names the goal; the dispatcher passes it on."""
        if self._goal is not None:
            self._goal.cancel()
        return ()

    def end(self, hangs: bool) -> None:
        """A goal that has no answer is given up."""
        goal, self._goal = self._goal, None
        if hangs and goal is not None:
            self._server.give_up(goal, "its dispatch does not end")

    def goal(self, owner: Optional[str] = None) -> str:
        """The one that was sent."""
        goal = self._goal
        if goal is not None and owner is not None:
            self._server.hand_over(goal, owner)
        return "" if goal is None else goal.id

    @property
    def busy(self) -> bool:
        """Whether it is known to carry out a plan."""
        return bool(self._status.state != DispatchStatus.IDLE)

    @property
    def failed_action(self) -> str:
        """The action of the present dispatch that failed, as PDDL text; empty: it names none."""
        return str(self._status.failed_action) if self._is_new else ""

    @property
    def at_rest(self) -> bool:
        """Whether no last status of the present dispatch may follow."""
        return self._is_new and not self.busy

    def started(self, progress: DispatchProgress) -> bool:
        """True when the status says so, or there is a goal to be named."""
        return self.busy or self._goal is not None

    def result(self, progress: DispatchProgress, reply: Reply) -> DispatchResult:
        """With what the status says of the failure."""
        if not self._is_new:
            return progress.result(reply)
        status = self._status
        return progress.result(reply, status.failed_action, status.reason, status.unmet_goals)

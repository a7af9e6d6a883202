# SPDX-License-Identifier: Apache-2.0
"""An action server that runs one goal at a time: a newer goal preempts the older one."""

import threading
from typing import Callable, Dict, List, Optional

import rospy

from merlin_ros.actions.action_server import ActionServer, ServerGoal
from merlin_ros.work.threads import failure_text, log_failure, start_thread
from merlin_ros.work.work_book import Decision, Policy, Step, WorkBook

NOT_BEGUN = "cancelled before it began"


class SerialActionServer:
    """Runs goals one after the other in one worker thread.

    A newer goal or a cancel sets the ``cancel_event`` of the running goal and calls ``on_cancel`` at once, in
    the subscriber's thread; a goal that waits behind it is recalled when a still newer one arrives.

    :param name: of the action.
    :param action_spec: the generated ``...Action`` class.
    :param execute: runs one goal to its end and ends it; a goal it leaves open is aborted.
    :param on_cancel: what has to happen at once, besides setting ``cancel_event``. Left out for a goal that
        the event has ended before: by then it could stop the next one.
    """

    def __init__(
        self,
        name: str,
        action_spec: type,
        execute: Callable[[ServerGoal], None],
        on_cancel: Callable[[ServerGoal], None] = lambda goal: None,
    ) -> None:
        self.server = ActionServer(name, action_spec, self._receive, self._cancel)
        self.name = self.server.name
        self._execute = execute
        self._on_cancel = on_cancel
        self._changed = threading.Condition()  # guards the three fields below
        self._book: WorkBook[str] = WorkBook(Policy.NEWEST, asked=True)
        self._goals: Dict[str, ServerGoal] = {}  # that wait or run
        self._stopping = False
        self._worker: Optional[threading.Thread] = None

    def start(self) -> None:
        """Begins to serve."""
        # One for all goals: a child process ends with the thread that has started it (`PR_SET_PDEATHSIG`).
        self._worker = start_thread(f"action {self.name}", self._work)
        self.server.start()

    def shutdown(self) -> None:
        """Cancels what runs, stops serving and waits up to a second for the worker."""
        with self._changed:
            self._stopping = True
            decisions = self._book.cancel_all("the server ends")
            self._changed.notify_all()
        self._carry_out(decisions)
        if self._worker is not None and threading.current_thread() is not self._worker:
            self._worker.join(1.0)
        self.server.shutdown()

    def _receive(self, goal: ServerGoal) -> None:
        with self._changed:
            overtaken = goal.cancel_requested  # by a cancel that did not find it here
            if not overtaken:
                self._goals[goal.id] = goal
                decisions = self._book.arrive(goal.id)
                self._changed.notify_all()
        if overtaken:
            goal.cancelled(text=NOT_BEGUN)
        else:
            self._carry_out(decisions)

    def _cancel(self, goal: ServerGoal) -> None:
        with self._changed:
            decisions = self._book.cancel(goal.id, NOT_BEGUN)
            runs = goal.id in self._goals and not any(each.what is Step.REFUSE for each in decisions)
        if runs:
            self._on_cancel(goal)  # also when it has raised before
        else:
            self._carry_out(decisions)

    def _carry_out(self, decisions: List[Decision]) -> None:
        """Stops and answers goals; without the lock."""
        for decision in decisions:
            with self._changed:
                goal = self._goals.get(decision.key)
                if decision.what is Step.REFUSE:
                    self._goals.pop(decision.key, None)
            if goal is None:  # it has ended since that was decided
                continue
            if decision.what is Step.REFUSE:
                goal.cancelled(text=decision.reason)
                continue
            self.server.cancel(goal)  # that it is not stopped does not concern the newer goal

    def _work(self) -> None:
        goal: Optional[ServerGoal] = None
        while True:
            with self._changed:
                if goal is not None:
                    self._book.end(goal.id)
                    del self._goals[goal.id]
                key = self._book.begin()
                while key is None and not self._stopping:
                    self._changed.wait()
                    key = self._book.begin()
                if key is None or self._stopping:
                    return
                goal = self._goals[key]
            if not goal.accept():  # it was answered meanwhile: nothing may run for it
                continue
            try:
                self._execute(goal)
            except BaseException as error:  # whatever a server's code does, the client gets an answer
                if not rospy.is_shutdown():
                    log_failure(f"action {self.name}")
                goal.abort(text=failure_text(error))
            if goal.abort(text="the server ended without a result"):
                rospy.logerr(f"action {self.name}: execution returned without a result")

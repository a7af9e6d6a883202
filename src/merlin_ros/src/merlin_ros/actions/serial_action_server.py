"""An action server that runs one goal at a time: a newer goal preempts the older one."""

import threading
import traceback
from typing import Callable, Optional

import rospy

from merlin_ros.actions.action_server import ActionServer, ServerGoal


class SerialActionServer:
    """Runs goals one after the other in one worker thread.

    A newer goal or a cancel sets the ``cancel_event`` of the running goal and calls ``on_cancel`` at once, in
    the subscriber's thread; a goal that waits behind it is recalled when a still newer one arrives.

    :param name: of the action.
    :param action_spec: the generated ``...Action`` class.
    :param execute: runs one goal to its end and ends it; a goal it leaves open is aborted.
    :param on_cancel: what has to happen at once, besides setting ``cancel_event``.
    """

    def __init__(
        self,
        name: str,
        action_spec: type,
        execute: Callable[[ServerGoal], None],
        on_cancel: Optional[Callable[[ServerGoal], None]] = None,
    ) -> None:
        self.server = ActionServer(name, action_spec, self._receive, self._cancel)
        self.name = self.server.name
        self._execute = execute
        self._on_cancel = on_cancel
        self._changed = threading.Condition()  # guards the three fields below
        self._running: Optional[ServerGoal] = None
        self._next: Optional[ServerGoal] = None
        self._stopping = False
        self._worker = threading.Thread(target=self._work, name=f"action {self.name}", daemon=True)

    def start(self) -> None:
        """Begins to serve."""
        self._worker.start()
        self.server.start()

    def shutdown(self) -> None:
        """Cancels what runs, stops serving and waits up to a second for the worker."""
        with self._changed:
            self._stopping = True
            running = self._running
            self._changed.notify_all()
        if running is not None and running.request_cancel():
            self._cancel(running)
        if threading.current_thread() is not self._worker:
            self._worker.join(1.0)
        self.server.shutdown()

    def _receive(self, goal: ServerGoal) -> None:
        with self._changed:
            waiting, self._next = self._next, goal
            running = self._running
            self._changed.notify_all()
        if waiting is not None:
            waiting.cancelled(text="a newer goal took its place")
        if running is not None and running.request_cancel():
            self._cancel(running)

    def _cancel(self, goal: ServerGoal) -> None:
        with self._changed:
            if self._next is goal:
                self._next = None
                goal.cancelled(text="cancelled before it began")
                return
        if self._on_cancel is None:
            return
        try:
            self._on_cancel(goal)
        except Exception:  # the execution sees its event all the same, and the newer goal is not concerned
            rospy.logerr(f"action {self.name}: {traceback.format_exc()}")

    def _work(self) -> None:
        while True:
            with self._changed:
                self._running = None
                while self._next is None:
                    if self._stopping:
                        return
                    self._changed.wait()
                if self._stopping:
                    return
                goal, self._next = self._next, None
                self._running = goal
            if not goal.accept():  # it was answered meanwhile: nothing may run for it
                continue
            try:
                self._execute(goal)
            except BaseException as error:  # whatever a server's code does, the client gets an answer
                if not rospy.is_shutdown():
                    rospy.logerr(f"action {self.name}: {traceback.format_exc()}")
                goal.abort(text=f"{type(error).__name__}: {error}")
            if goal.abort(text="the server ended without a result"):
                rospy.logerr(f"action {self.name}: execution returned without a result")

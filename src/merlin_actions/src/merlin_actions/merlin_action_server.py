"""Serves a state machine as the action ``actions/<name>``."""

import threading
import traceback
from typing import Any, List, Optional

import rospy
from merlin_msgs.msg import RunActionAction, RunActionFeedback, RunActionResult

from merlin_actions.merlin_action_sm import MerlinActionSM
from merlin_actions.names import action_param, ros_name
from merlin_sm.action_server import ActionServer, ServerGoal
from merlin_sm.health import OK, WARN, Health
from merlin_sm.introspection import show
from merlin_sm.states.merlin_state import PREEMPTED, SUCCEEDED

SHUTDOWN_WAIT = 2.0
"""Wall seconds in which a running machine can stop the robot when its node ends."""


class MerlinActionServer:
    """Runs one :class:`MerlinActionSM` for the goals of its action, one at a time.

    A goal that comes while another runs is rejected: a machine has one set of states.

    :param machine: it.
    """

    def __init__(self, machine: MerlinActionSM) -> None:
        self.machine = machine
        self.operator = machine.operator_name()
        self._lock = threading.Lock()  # guards _running and _crash
        self._idle = threading.Condition(self._lock)
        self._running: Optional[ServerGoal] = None
        self._crash = ""  # what the last run raised
        self._server = ActionServer(
            f"actions/{ros_name(self.operator)}", RunActionAction, self._receive, self._cancel
        )
        machine.register_start_cb(self._cancelled_before_start)
        machine.register_transition_cb(self._tell_state)

    def start(self) -> None:
        """Declares the action's facts to its bridge, shows the machine and begins to serve."""
        for key in ("while_running", "if_interrupted"):
            rospy.set_param(action_param(self.operator, key), list(getattr(self.machine, key)))
        self._introspection = show(ros_name(self.operator).upper(), self.machine)
        self._server.start()

    def shutdown(self) -> None:
        """Preempts what runs, waits until it has stopped, at most ``SHUTDOWN_WAIT``, and stops serving."""
        with self._lock:
            running = self._running
        if running is not None:
            self.machine.request_preempt()
            with self._idle:
                self._idle.wait_for(lambda: self._running is not running, SHUTDOWN_WAIT)
        self._server.shutdown()
        self._introspection.stop()

    def health(self) -> Health:
        """What the machine does; a warning when its last run raised an exception."""
        with self._lock:
            running, crash = self._running is not None, self._crash
        doing = "running" if running else "idle"
        return Health(WARN, f"{doing}; the last run raised {crash}") if crash else Health(OK, doing)

    def _receive(self, goal: ServerGoal) -> None:
        with self._lock:
            free = self._running is None
            if free:
                self._running = goal
        if not free:
            goal.reject(
                RunActionResult(reason=f"{self.operator} runs already"), f"{self.operator} runs already"
            )
            return
        goal.accept()
        threading.Thread(target=self._run, args=(goal,), name=f"machine {self.operator}", daemon=True).start()

    def _cancel(self, goal: ServerGoal) -> None:
        with self._lock:
            running = self._running is goal
        if running:
            self.machine.request_preempt()

    def _run(self, goal: ServerGoal) -> None:
        parameters = {parameter.key: parameter.value for parameter in goal.goal.parameters}
        crash = ""
        missing = [name for name in self.machine.parameters if name not in parameters]
        try:
            if missing:
                outcome, reason = "aborted", f"{self.operator}: no value for parameter {', '.join(missing)}"
            elif goal.cancel_requested:
                outcome, reason = PREEMPTED, "cancelled"
            else:
                outcome = self.machine.run_once(parameters)
                reason = self.machine.reason
        except Exception as error:  # user code may raise anything; the bridge still gets its answer
            rospy.logerr(f"{self.operator}: {traceback.format_exc()}")
            crash = f"{type(error).__name__}: {error}"
            outcome, reason = "aborted", crash
        with self._lock:
            self._running, self._crash = None, crash
            self._idle.notify_all()
        self._end(goal, outcome, reason)

    def _end(self, goal: ServerGoal, outcome: str, reason: str) -> None:
        if outcome == SUCCEEDED:
            goal.succeed(RunActionResult(outcome=outcome))
        elif goal.cancel_requested and outcome == PREEMPTED:
            goal.cancelled(RunActionResult(outcome, reason or "cancelled"), reason or "cancelled")
        else:
            reason = reason or f"the machine ended with {outcome}"
            goal.abort(RunActionResult(outcome, reason), reason)

    def _cancelled_before_start(self, userdata: Any, initial_states: List[str]) -> None:
        # A cancel between the goal's acceptance and this point found a machine that did not run yet, and
        # SMACH forgets the flags of idle machines. request_preempt() would deadlock in a callback of the
        # original SMACH, so the flag it sets is set here.
        with self._lock:
            running = self._running
        if running is not None and running.cancel_requested:
            self.machine._preempt_requested = True
        self._feedback(initial_states)

    def _tell_state(self, userdata: Any, active_states: List[str]) -> None:
        self._feedback(active_states)

    def _feedback(self, states: List[str]) -> None:
        with self._lock:
            running = self._running
        if running is not None:
            path = f"{ros_name(self.operator).upper()}/{','.join(states)}"
            running.feedback(RunActionFeedback(state=path))

# SPDX-License-Identifier: Apache-2.0
"""What `rosrun merlin send` prints while its goals wait and run."""

import threading
from typing import Callable, Optional

import rospy
from merlin_msgs.msg import ExecuteFeedback, ExecutorStatus, GuardStatus

from merlin_executor.core.base_hold import hold_words
from merlin_executor.executor_request import ExecutorRequest
from merlin_planning.knowledge_text import step_text
from merlin_ros.work.passed_time import clock_text


class SendProgress:
    """Prints the stage of a request, and what it waits for, once for each change.

    :param say: takes a line.
    """

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._lock = threading.Lock()  # guards the fields below
        self._request: Optional[ExecutorRequest] = None
        self._not_before: Optional[rospy.Time] = None
        self._said = ""
        self._reason = ""  # said last; while the next plan is carried out it is that of the plan before
        self._company = ""  # as it was said last
        self._feedback: Optional[ExecuteFeedback] = None
        self._status: Optional[ExecutorStatus] = None
        self._guard: Optional[GuardStatus] = None

    def follow(self, robot: str, request: ExecutorRequest, not_before: Optional[rospy.Time] = None) -> None:
        """Follows the Executor and the guard of a robot.

        :param robot: its namespace.
        :param not_before: ROS time before which the request does not begin; None: it may at once.
        """
        with self._lock:
            self._request, self._not_before = request, not_before
        for name, kind, take in (
            ("status", ExecutorStatus, self.executor),
            ("guard", GuardStatus, self.guard),
        ):
            rospy.Subscriber(f"{robot}/merlin/{name}", kind, take, tcp_nodelay=True)

    def feedback(self, feedback: ExecuteFeedback) -> None:
        """Takes a feedback of the request."""
        with self._lock:
            self._feedback = feedback
            self._print()

    def executor(self, status: ExecutorStatus) -> None:
        """Takes the Executor's status."""
        with self._lock:
            self._status = status
            self._print_company(status)
            self._print()

    def guard(self, status: GuardStatus) -> None:
        """Takes the status of the robot's guard."""
        with self._lock:
            self._guard = status
            self._print()

    def _print(self) -> None:
        said = self._obstacle() or self._doing()
        if said and said != self._said:
            self._said = said
            self._say(f"  {said}")

    def _print_company(self, status: ExecutorStatus) -> None:
        """Says with which other requests it runs in one plan, once for each change."""
        running = {status.request: status.goals, **{other.request: other.goals for other in status.together}}
        if self._request is None or running.pop(self._request.id, None) is None:
            return
        company = ", ".join(goal for goals in running.values() for goal in goals)
        if company and company != self._company:
            self._say(f"  in one plan with {company}")
        self._company = company

    def _obstacle(self) -> str:
        """What the request waits for; empty: nothing."""
        guard, status, request = self._guard, self._status, self._request
        if request is None or request.done:
            return ""
        if guard is not None and guard.state == GuardStatus.STOPPED:
            held = hold_words("", guard.reason, guard.since.to_sec())
            return f"{held}; `rosservice call merlin/release` lets it move again"
        if status is None:
            return ""
        if status.waits:  # of several robots, of which one is held
            return f"{status.waits}; `merlin/release` of that robot lets it move again"
        if status.held:
            return f"held at the breakpoint {status.held}"
        if request.id in (status.request, *(other.request for other in status.together)):
            return guard.warning if guard is not None else ""
        if self._feedback is not None and self._feedback.reason and not self._feedback.stage:
            return self._feedback.reason  # while it waits
        if status.paused and status.state == ExecutorStatus.IDLE:
            return "waits: the Executor is paused; `rosservice call merlin/resume` lets it go on"
        if self._not_before is not None and self._not_before > rospy.Time.now():
            return f"waits until {clock_text(self._not_before.to_sec())}"
        return f"waits: {', '.join(status.goals)} runs" if status.request and status.goals else ""

    def _doing(self) -> str:
        feedback = self._feedback
        if feedback is None:
            return ""
        if feedback.running:
            return ", ".join(map(step_text, feedback.running))
        old = feedback.stage in ("DISPATCH_PLAN", "REPLAN") and feedback.reason == self._reason
        if feedback.reason and not old:
            self._reason = feedback.reason
            return feedback.reason
        return "planning" if feedback.stage == "PLAN" else ""

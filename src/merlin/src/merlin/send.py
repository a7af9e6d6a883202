# SPDX-License-Identifier: Apache-2.0
"""The command `rosrun merlin send`: sends goals to the Executor, and shows what becomes of them."""

import argparse
import threading
from typing import Callable, Optional

import rospy
from merlin_msgs.msg import ExecuteFeedback, ExecuteResult, ExecutorStatus, GuardStatus
from rospy.core import is_shutdown_requested

from merlin.running import at_robot
from merlin_executor.core.standstill import clock_text, hold_words
from merlin_executor.executor_client import DROP, NEVER, RESUME, MerlinExecutorClient, outcome_name
from merlin_executor.executor_request import GOES_ON, ExecutorRequest
from merlin_executor.goal_check import GoalError
from merlin_executor.request_times import Written, at_time, read_time
from merlin_planning.knowledge_client import DEFAULT_KNOWLEDGE_BASE, KnowledgeError
from merlin_ros.service_proxy import ServiceError

EXIT_NOT_ACHIEVED = 1
EXIT_INTERRUPTED = 130
LIMIT = 30.0  # s for the Executor to answer
STOP_LIMIT = 10.0  # s for a cancelled goal to end


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
        running = [
            f"({' '.join([action.name, *(parameter.value for parameter in action.parameters)])})"
            for action in feedback.running
        ]
        return ", ".join(running) or feedback.reason or ("planning" if feedback.stage == "PLAN" else "")


def main() -> int:
    """Sends goals and waits; returns the exit code: 0, 1 not achieved, 2 a mistake, 130 after Ctrl-C."""
    parser = argparse.ArgumentParser(
        prog="rosrun merlin send",
        description="Sends goals to the Executor and waits until they hold. Ctrl-C cancels them.",
    )
    parser.add_argument("goal", nargs="*", help='PDDL, one or many: "(checked kitchen)"')
    parser.add_argument("--priority", type=int, default=0, help="a higher one interrupts what runs")
    parser.add_argument("--timeout", type=float, metavar="S", help="cancel them after this time")
    parser.add_argument(
        "--not-before", type=_time, metavar="TIME", help="begin then: 10min from now, or 14:30"
    )
    parser.add_argument(
        "--deadline", type=_time, metavar="TIME", help="end as LATE what does not hold by then"
    )
    parser.add_argument("--alone", action="store_true", help="never plan them together with other requests")
    interrupted = parser.add_mutually_exclusive_group()
    interrupted.add_argument("--drop", action="store_true", help="drop them when they are interrupted")
    interrupted.add_argument(
        "--uninterrupted", action="store_true", help="more urgent ones wait for their end"
    )
    parser.add_argument("--value", type=float, default=1.0, help="worth, where not all can be in time")
    parser.add_argument(
        "--survives", action="store_true", help="go on without this command, after a power cut too"
    )
    known_one = parser.add_mutually_exclusive_group()
    known_one.add_argument(
        "--follow", metavar="ID", help="show a request that survives, instead of sending goals"
    )
    known_one.add_argument("--cancel", metavar="ID", help="cancel a request that survives")
    parser.add_argument("--robot", help="namespace of the robot, where there are several")
    given = parser.parse_args()
    known = given.cancel or given.follow
    if bool(given.goal) is bool(known):
        parser.error("give either goals, or --follow or --cancel")
    refusals = (GoalError, ValueError, KnowledgeError, ServiceError)
    return at_robot("merlin send", given.robot, lambda robot: _send(given, robot), *refusals)


def _send(given: argparse.Namespace, robot: str) -> int:
    client = MerlinExecutorClient(f"{robot}merlin/execute", f"{robot}{DEFAULT_KNOWLEDGE_BASE}")
    if not client.wait_for_executor(LIMIT):
        raise ServiceError(f"the Executor does not answer within {LIMIT:g} s")
    not_before = at_time(given.not_before, "--not-before")
    progress = SendProgress(lambda line: print(line, flush=True))
    known = given.cancel or given.follow
    request = (
        client.follow(known, on_feedback=progress.feedback)
        if known
        else client.send(
            given.goal,
            priority=given.priority,
            on_interrupt=DROP if given.drop else NEVER if given.uninterrupted else RESUME,
            on_feedback=progress.feedback,
            not_before=not_before,
            deadline=at_time(given.deadline, "--deadline"),
            alone=given.alone,
            survives=given.survives,
            value=given.value,
        )
    )
    if given.cancel:
        request.cancel()
    elif request.survives:
        print(f"  survives as {request.id}", flush=True)
    progress.follow(robot.rstrip("/"), request, not_before)
    rospy.on_shutdown(lambda: _leave(request))
    if not request.wait(given.timeout) and not is_shutdown_requested():
        print(f"not achieved within {given.timeout:g} s: cancelled", flush=True)
        request.cancel()
        request.wait()
    result = request.result
    if result is None:  # Ctrl-C, and the Executor has not answered
        print("cancelled", flush=True)
        return EXIT_INTERRUPTED
    reason = f": {result.reason}" if result.reason else ""
    print(GOES_ON if result.reason == GOES_ON else f"{outcome_name(result.outcome)}{reason}", flush=True)
    # rospy.is_shutdown() says so only after the cancel; the result may come before.
    if is_shutdown_requested():
        return EXIT_INTERRUPTED
    done = ExecuteResult.CANCELLED if given.cancel else ExecuteResult.SUCCEEDED
    return 0 if result.outcome in (done, ExecuteResult.ALREADY_TRUE) else EXIT_NOT_ACHIEVED


def _time(text: str) -> Written:
    try:
        return read_time(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def _leave(request: ExecutorRequest) -> None:
    if not request.done:
        request.leave()
        request.wait(STOP_LIMIT)

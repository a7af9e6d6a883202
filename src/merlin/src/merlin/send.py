# SPDX-License-Identifier: Apache-2.0
"""The command `rosrun merlin send`: sends goals to the Executor, and shows what becomes of them."""

import argparse

import rospy
from merlin_msgs.msg import ExecuteResult
from rospy.core import is_shutdown_requested

from merlin.running import EXIT_INTERRUPTED, at_robot
from merlin.send_progress import SendProgress
from merlin_executor.executor_client import DROP, NEVER, RESUME, MerlinExecutorClient, outcome_name
from merlin_executor.executor_request import GOES_ON, ExecutorRequest
from merlin_executor.goal_check import GoalError
from merlin_executor.request_times import Written, at_time, read_time
from merlin_planning.knowledge_client import DEFAULT_KNOWLEDGE_BASE, KnowledgeError
from merlin_ros.processes.option_number import option_number
from merlin_ros.service_proxy import ServiceError

EXIT_NOT_ACHIEVED = 1
LIMIT = 30.0  # s for the Executor to answer
SILENT = 2.0  # s of them that pass without a line
STOP_LIMIT = 10.0  # s for a cancelled goal to end


def main() -> int:
    """Sends goals and waits; returns the exit code: 0, 1 not achieved, 2 a mistake, 130 after Ctrl-C."""
    parser = argparse.ArgumentParser(
        prog="rosrun merlin send",
        description="Sends goals to the Executor and waits until they hold. Ctrl-C cancels them.",
    )
    parser.add_argument("goal", nargs="*", help='PDDL, one or many: "(checked kitchen)"')
    parser.add_argument("--priority", type=int, default=0, help="a higher one interrupts what runs")
    parser.add_argument(
        "--timeout",
        type=option_number("a number of seconds above 0", above=0.0),
        metavar="S",
        help="cancel them after this time",
    )
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
    if not client.wait_for_executor(SILENT):
        print(f"  waiting for the Executor, {LIMIT:g} s at most", flush=True)
        if not client.wait_for_executor(LIMIT - SILENT):
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

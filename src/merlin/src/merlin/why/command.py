# SPDX-License-Identifier: Apache-2.0
"""The command `rosrun merlin why`: asks a robot that runs, or a recorded run, why, and prints the answer."""

import argparse
import sys
import time
from functools import partial
from pathlib import Path
from typing import Any, Dict, List, Sequence

import rospy
from merlin_msgs.msg import Claim, Evidence
from merlin_msgs.srv import Explain, ExplainRequest, ExplainResponse
from rospy.core import is_shutdown_requested

from merlin.running import EXIT_INTERRUPTED, EXIT_REFUSED, at_robot
from merlin_executor.request_times import read_time, ros_now
from merlin_monitor.terminal.terminal_view import printable
from merlin_ros.call_scope import CallScope
from merlin_ros.service_proxy import ServiceError, ServiceProxy

#: s of wall time for an answer: longer than any question takes.
LIMIT = 60.0
#: Option → the question that it asks, where it is one by itself.
_ALONE = {
    "no_plan": ExplainRequest.NO_PLAN,
    "waiting": ExplainRequest.WAITING,
    "failed": ExplainRequest.FAILED,
    "so": ExplainRequest.SO,
    "doing": ExplainRequest.DOING,
}


def main() -> int:
    """Asks, prints the answer; returns the exit code: 0 answered, 2 a mistake, 130 after Ctrl-C."""
    given = parser().parse_args()
    try:
        request = request_of(given)
        if given.recording is not None:
            return _ask_recording(request, given)
    except ValueError as error:
        print(f"merlin why: {error}", file=sys.stderr)
        return EXIT_REFUSED
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED
    refusals = (ServiceError, ValueError)
    return at_robot("merlin why", given.robot, lambda robot: _ask(robot, request, given), *refusals)


def parser() -> argparse.ArgumentParser:
    """Reads the command line."""
    made = argparse.ArgumentParser(
        prog="rosrun merlin why",
        description="Says why the robot does what it does. Nothing moves because of a question.",
    )
    made.add_argument("about", nargs="?", default="", help='step or goal: "(deliver box_1 ward_2)"')
    other = made.add_argument_group("why not another plan")
    other.add_argument("--not", dest="include", **_many("ACTION", "one that does this, too"))
    other.add_argument("--without", **_many("ACTION", "one without this; * is any object"))
    other.add_argument("--first", **_many("GOAL", "one that reaches this goal before the others"))
    others = made.add_argument_group("other questions")
    others.add_argument("--no-plan", action="store_true", help="what is missing for the goals")
    others.add_argument("--what-if", dest="facts", **_many("FACT", "the plan, if this were so"))
    others.add_argument(
        "--goal", dest="goals", **_many("GOAL", "of the plan, in place of those that there are")
    )
    others.add_argument("--waiting", action="store_true", help="what a step or a request waits for")
    others.add_argument("--failed", action="store_true", help="why the last thing failed")
    others.add_argument("--so", action="store_true", help="why a fact is as it is")
    others.add_argument("--doing", action="store_true", help="what the robot does, and how long")
    made.add_argument("--at", metavar="TIME", help="of a past moment: 10min ago, or 14:30 of that day")
    made.add_argument("--evidence", action="store_true", help="print what shows each claim, too")
    made.add_argument("--robot", help="namespace of the robot, where there are several")
    past = made.add_argument_group("of a run that has ended, without a robot; ago is then before its end")
    past.add_argument("--recording", type=Path, metavar="PATH", help="its history or bag, or their folder")
    past.add_argument("--run", type=int, default=0, help="number of a run in a history; else the newest one")
    past.add_argument("--domain", type=Path, metavar="FILE", help="PDDL file, of a recording without it")
    return made


def _many(what: str, text: str) -> Dict[str, Any]:
    return {"action": "append", "default": [], "metavar": what, "help": text}


def request_of(given: argparse.Namespace) -> ExplainRequest:
    """The request for what a command line asks.

    :raises ValueError: it asks nothing, or two things.
    """
    asked = [question for option, question in _ALONE.items() if getattr(given, option)]
    if given.include or given.without or given.first:
        asked.append(ExplainRequest.WHY_NOT)
    if given.facts or (given.goals and not asked):
        asked.append(ExplainRequest.WHAT_IF)
    without = list(given.without)
    if ExplainRequest.WHY_NOT in asked and given.about:
        without.append(given.about)  # why this step and not that one
    if len(asked) > 1:
        raise ValueError("that is more than one question; ask one after the other")
    if given.recording is None and (given.run or given.domain):
        raise ValueError("--run and --domain are for --recording")
    if not asked and not given.about:
        raise ValueError('ask about a step or a goal, "(checked kitchen)", or see --help')
    return ExplainRequest(
        question=asked[0] if asked else ExplainRequest.WHY,
        about=given.about,
        include=given.include,
        without=without,
        first=given.first,
        facts=given.facts,
        goals=given.goals,
    )


def _ask(robot: str, request: ExplainRequest, given: argparse.Namespace) -> int:
    if given.at:
        request.at = _moment(given.at, ros_now("--at"))
    service = ServiceProxy(f"{robot}merlin/explain", Explain, timeout=LIMIT, patience=2.0)
    try:
        with CallScope() as scope:
            rospy.on_shutdown(scope.end)
            answer = service(request)
    except ServiceError:
        if is_shutdown_requested():  # Ctrl-C
            return EXIT_INTERRUPTED
        raise
    if not answer.ok:
        print(f"merlin why: {printable(answer.sentence)}", file=sys.stderr)
        return EXIT_REFUSED
    return _print(answer, given)


def _ask_recording(request: ExplainRequest, given: argparse.Namespace) -> int:
    from merlin_explain.node.recorded_run import ask_recording

    moment = partial(_moment, given.at) if given.at else None
    return _print(ask_recording(given.recording, request, moment, given.run, given.domain), given)


def _print(answer: ExplainResponse, given: argparse.Namespace) -> int:
    for line in (answer.sentence, *lines(answer.claims, given.evidence)):
        print(printable(line), flush=True)
    return 0


def _moment(text: str, now: float) -> rospy.Time:
    """A past ROS time: s ago, or a time of the day.

    :param now: s of ROS time.
    :raises ValueError: for another text, and a time that has not passed.
    """
    written = read_time(text)
    if isinstance(written, float):
        at = now - written
    else:
        at = time.mktime((*time.localtime(now)[:3], *written, 0, 0, -1))
    if not 0.0 < at <= now:
        raise ValueError(f"--at {text}: there is no such past moment")
    return rospy.Time.from_sec(at)


def lines(claims: Sequence[Claim], evidence: bool) -> List[str]:
    """The claims of an answer, as they are printed.

    :param evidence: whether that is printed, too.
    """
    found: List[str] = []
    for claim in claims:
        found.append(f"  - {claim.text}")
        found += [line for each in claim.evidence for line in _shown(each)] if evidence else []
    return found


def _shown(evidence: Evidence) -> List[str]:
    first, *more = evidence.text.split("\n")
    where = [
        f"step {evidence.step}" if evidence.step else "",
        f"version {evidence.version}" if evidence.version else "",
        f"{evidence.time.to_sec():.3f} s" if evidence.time.to_sec() else "",
    ]
    place = ", ".join(filter(None, where))
    shown = f"      {evidence.kind}: {first}{f' ({place})' if place else ''}"
    return [shown, *(f"        {line}" for line in more)]

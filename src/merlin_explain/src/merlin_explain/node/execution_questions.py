# SPDX-License-Identifier: Apache-2.0
"""Answers about moments, from the one recording that there is: the monitor's history."""

import contextlib
import sqlite3
import time
from pathlib import Path
from typing import Collection, Iterator, List, Set

import rospy
from merlin_msgs.srv import ExplainRequest
from rosplan_knowledge_msgs.srv import GetAttributeService

from merlin_explain.claims import Answer, QuestionError, Words
from merlin_explain.execution.doing import doing
from merlin_explain.execution.failed import failed
from merlin_explain.execution.moment import Change, Moment
from merlin_explain.execution.provenance import provenance
from merlin_explain.execution.recorded_past import RecordedPast
from merlin_explain.execution.waiting import waiting
from merlin_explain.node.robot_system import RobotSystem
from merlin_monitor.history.history_file import HistoryError
from merlin_pddl.text_reader import PddlError
from merlin_planning.knowledge_text import to_pddl
from merlin_ros.master.master_link import ERRORS, bounded_master, get_param
from merlin_ros.service_proxy import ServiceError, ServiceProxy
from merlin_ros.work.passed_time import clock_text

STALE = 5.0  # s after which what was recorded last does not count as now: a monitor records twice per s
CALL_LIMIT = 5.0  # s of wall time
MONITOR = "merlin_monitor"
NO_HISTORY = "none"


def tell(
    question: ExplainRequest,
    moment: Moment,
    past: RecordedPast,
    domain: str,
    words: Words,
    interfaces: Collection[str],
) -> Answer:
    """Answers a question about a moment.

    :param past: of before the moment.
    :param domain: as PDDL text.
    :param interfaces: the nodes that apply the effects of actions, where they are known.
    :raises QuestionError: it is wrong.
    """
    if question.question == ExplainRequest.WAITING:
        return waiting(moment, question.about, words)
    if question.question == ExplainRequest.FAILED:
        return failed(moment, past, question.about, words)
    if question.question == ExplainRequest.SO:
        return provenance(moment, past, question.about, words, interfaces)
    if question.question == ExplainRequest.DOING:
        return doing(moment, question.about, words)
    from merlin_explain.node.plan_questions import of_plans  # with what judges plans
    from merlin_explain.node.recorded_system import RecordedSystem

    with contextlib.closing(RecordedSystem(past, moment, domain, words)) as recorded:
        answer = of_plans(question, recorded)
        if question.question == ExplainRequest.WHY:
            return answer
        more = recorded.reservations()
        said = " ".join([answer.sentence, *(claim.text for claim in more)])
        return Answer(said, (*answer.claims, *more))


def of_execution(question: ExplainRequest, system: RobotSystem) -> Answer:
    """Answers it of a robot that runs, questions about plans of a past moment."""
    with usable_history(), contextlib.closing(
        RecordedPast(_history(), system.domain(), question.at.to_sec(), session=_session())
    ) as past:
        moment = past.moment()
        if not question.at:
            age = past.age(moment, time.monotonic(), time.time())
            simulator = moment.section("meta").get("simulator") or {}
            if age > STALE and not simulator.get("paused"):  # a world that rests has nothing to record
                raise QuestionError(
                    f"the monitor has recorded nothing for {age:.0f} s; is it running? "
                    f"What was so until {clock_text(moment.at)} can be asked with that time"
                )
            moment.timed = _timed(system)
        interfaces = _interfaces(system.names.dispatcher) if question.question == ExplainRequest.SO else ()
        return tell(question, moment, past, system.domain_text(), system.words(), interfaces)


@contextlib.contextmanager
def usable_history() -> Iterator[None]:
    """Within it, a history or PDDL that cannot be used is a mistake of the question.

    :raises QuestionError: instead of HistoryError, sqlite3.Error and PddlError.
    """
    try:
        yield
    except (HistoryError, sqlite3.Error) as error:
        raise QuestionError(f"the history cannot be used: {error}") from error
    except PddlError as error:
        raise QuestionError(str(error)) from error


def _history() -> Path:
    name = rospy.resolve_name(f"{MONITOR}/history")
    text = str(get_param(name, ""))
    if text in ("", NO_HISTORY):
        raise QuestionError(
            f"no history is kept: parameter {name} names none; such questions need a monitor with its history"
        )
    return Path(text).expanduser()


def _session() -> str:
    """What the monitor writes beside its run: several robots may share a file."""
    run = get_param("/run_id", "")
    return f"{run} {rospy.resolve_name(MONITOR)}" if run else ""


def _timed(system: RobotSystem) -> List[Change]:
    """The facts that wait for their time; the original ROSPlan does not say."""
    name = f"{system.knowledge.name}/state/timed_knowledge"
    service = ServiceProxy(name, GetAttributeService, timeout=CALL_LIMIT)
    try:
        items = service("").attributes
    except ServiceError:
        return []
    return [Change("+", to_pddl(item), "", item.initial_time.to_sec()) for item in items]


def _interfaces(dispatcher: str) -> Set[str]:
    """The nodes that answer for actions, and so apply their effects."""
    try:
        publishers = dict(bounded_master().getSystemState()[0])
    except ERRORS:
        return set()
    own = rospy.resolve_name(f"{dispatcher}/action_dispatch")
    answers = rospy.resolve_name(f"{dispatcher}/action_feedback")
    return set(publishers.get(answers, [])) - set(publishers.get(own, []))

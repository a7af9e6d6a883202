# SPDX-License-Identifier: Apache-2.0
"""Answers to questions about what happens, from the one recording that there is: the monitor's history."""

import contextlib
import sqlite3
import time
from pathlib import Path
from typing import Iterator, List, NamedTuple, Set

import rospy
from rosplan_knowledge_msgs.srv import GetAttributeService

from merlin_explain.claims import Answer, Question, QuestionError
from merlin_explain.happening.doing import doing as tell_doing
from merlin_explain.happening.failed import failed as tell_failed
from merlin_explain.happening.moment import Change, Moment, clock
from merlin_explain.happening.provenance import provenance
from merlin_explain.happening.recorded_past import RecordedPast
from merlin_explain.happening.waiting import waiting as tell_waiting
from merlin_explain.node.robot_system import RobotSystem
from merlin_monitor.history.history_file import HistoryError
from merlin_planning.knowledge_text import to_pddl
from merlin_ros.master.master_link import ERRORS, bounded_master, get_param
from merlin_ros.service_proxy import ServiceError, ServiceProxy

STALE = 5.0  # s after which what was recorded last does not count as now: a monitor records twice per s
CALL_LIMIT = 5.0  # s of wall time
MONITOR = "merlin_monitor"
NO_HISTORY = "none"


class _Asked(NamedTuple):
    moment: Moment
    past: RecordedPast


def waiting(question: Question, system: RobotSystem) -> Answer:
    """What a step or a request waits for."""
    with _asked(question, system) as asked:
        return tell_waiting(asked.moment, question.about, system.words())


def failed(question: Question, system: RobotSystem) -> Answer:
    """Why something failed."""
    with _asked(question, system) as asked:
        return tell_failed(asked.moment, asked.past, question.about, system.words())


def so(question: Question, system: RobotSystem) -> Answer:
    """Why a fact is as it is."""
    with _asked(question, system) as asked:
        interfaces = _interfaces(system.names.dispatcher)
        return provenance(asked.moment, asked.past, question.about, system.words(), interfaces)


def doing(question: Question, system: RobotSystem) -> Answer:
    """What is done, and when it ends."""
    with _asked(question, system) as asked:
        return tell_doing(asked.moment, question.about, system.words())


@contextlib.contextmanager
def _asked(question: Question, system: RobotSystem) -> Iterator[_Asked]:
    """The moment that is asked about, and what was before.

    :raises QuestionError: it is not recorded.
    """
    try:
        with contextlib.closing(RecordedPast(_history(), system.domain(), question.at, _session())) as past:
            moment = past.moment()
            age = abs(time.time() - past.wall)
            if not question.at:
                if age > STALE:
                    raise QuestionError(
                        f"the monitor has recorded nothing for {age:.0f} s; is it running? "
                        f"What was so until {clock(moment.at)} can be asked with that time"
                    )
                moment.timed = _timed(system)
            yield _Asked(moment, past)
    except (HistoryError, sqlite3.Error) as error:
        raise QuestionError(f"the history cannot be used: {error}") from error


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
        items = service("").attributes if service.available() else []
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

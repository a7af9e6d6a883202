# SPDX-License-Identifier: Apache-2.0
"""What a question about plans may ask of a moment of a recording. What plans is started when it is needed."""

import contextlib
import functools
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any, Dict, Iterator, List, Tuple

from merlin_msgs.srv import PreviewPlanRequest, PreviewPlanResponse

from merlin_explain.claims import EVENT, Claim, Evidence, QuestionError, Words
from merlin_explain.core.why import Doing, Request
from merlin_explain.execution.moment import RUNNING, Moment, key_of
from merlin_explain.execution.recorded_past import PANEL, RecordedPast
from merlin_monitor.text.request_words import sender_of
from merlin_pddl.analysis.plan_run import plan_fault
from merlin_pddl.checks.installed_planners import is_preset
from merlin_pddl.knowledge import Fact, FunctionValue, Timed
from merlin_pddl.plan_text import NO_DURATION, PlanStep, format_plan
from merlin_pddl.problem import Problem
from merlin_pddl.problem_reader import parse_condition, parse_problem
from merlin_pddl.problem_writer import object_lines, write_problem
from merlin_pddl.text_reader import PddlError
from merlin_ros.ports.service_server import while_wanted
from merlin_ros.work.passed_time import clock_text

#: Nice value of what plans: the robot's own planning goes first.
NICENESS = 10
#: Said of plans that are made of a moment without these parts.
UNKNOWN = "Its metric and the facts that come true by themselves are not recorded of that time."
#: s of ROS time around a plan in which frames are looked at, and from one look to the next.
AROUND, BETWEEN = 1.0, 0.1


class RecordedSystem:
    """A robot at a moment; see :class:`.plan_questions.System`. To be closed.

    :param past: of before the moment.
    :param domain: as PDDL text.
    """

    def __init__(self, past: RecordedPast, moment: Moment, domain: str, words: Words) -> None:
        self._past, self._moment, self._domain, self._words = past, moment, domain, words
        self._ends = contextlib.ExitStack()

    def close(self) -> None:
        """Ends what plans."""
        self._ends.close()

    def domain_text(self) -> str:
        """Its domain as PDDL."""
        return self._domain

    def words(self) -> Words:
        """What its steps and facts are called."""
        return self._words

    def planned(self) -> Tuple[str, str]:
        """The last plan of the moment: the problem that it was made for, and its text.

        :raises QuestionError: there is none, or it does not fit what is recorded of when it was made.
        """
        steps = sorted(
            (
                PlanStep(
                    round(step.start, 3), step.name, step.objects, max(round(step.duration, 3), NO_DURATION)
                )
                for step in self._moment.steps
            ),
            key=lambda step: step.time,
        )
        if not steps:
            raise QuestionError(
                f"there was no plan at {clock_text(self._moment.at)}, so no step can be asked about"
            )
        for problem in self._problems():
            if not plan_fault(self._moment.domain, problem, steps):
                return write_problem(problem, self._moment.domain), format_plan(steps)
        raise QuestionError(
            "the recorded plan does not fit the facts that are recorded of when it was made: it was made for "
            "a state that was still to come, or for facts that come true by themselves; `why --waiting` and "
            "`why --failed` need no plan"
        )

    def doing(self) -> Doing:
        """What becomes of the plan."""
        asked = self._moment.requests
        running = [step for step in self._moment.steps if step.state in RUNNING]
        running.sort(key=lambda step: (step.began or 0.0) + step.duration)
        requests = [
            Request(name, each["goals"], each.get("by") or sender_of(name), each["priority"])
            for each in (*asked, *self._moment.queue)
            for name in [each["request"]]
        ]
        return Doing(bool(running or asked), [step.text for step in running], requests)

    def goals(self) -> List[str]:
        """The goals of the knowledge base as PDDL text."""
        return list(self._moment.section("knowledge").get("goals") or ())

    def reservations(self) -> List[Claim]:
        """What has to be said with each plan that is made for an answer."""
        said = []
        if self._moment.section(PANEL).get("problem") is None:
            said.append(UNKNOWN)
        command, named = self._command()
        if command and not named:
            said.append(f"It was planned by kairos: the planner of the robot, “{command}”, is not run here.")
        missing = _missing(command) if named else ""
        if missing:
            said.append(f"Of the robot's planners not all are here: {missing}.")
        return [Claim("unknown", text, (Evidence(EVENT, text, time=self._moment.at),)) for text in said]

    def _command(self) -> Tuple[str, bool]:
        """The planner of the robot, and whether it has a name: others are programs of its computer."""
        command = str(self._moment.section(PANEL).get("planner", {}).get("planner_command", ""))
        names = [name.strip() for name in command.split("+")]
        return command, all(name == "kairos" or is_preset(name) for name in names)

    def preview(self, **request: Any) -> PreviewPlanResponse:
        """A plan from the moment on.

        :param request: fields of ``merlin_msgs/PreviewPlan``.
        """
        return self._look(PreviewPlanRequest(**request))

    @functools.cached_property
    def _look(self) -> Any:
        """Looks for plans, in a process of its own."""
        from merlin_rosplan.nodes.preview_service import look_for_plan
        from merlin_rosplan.planning.planner_settings import PlannerSettings
        from merlin_rosplan.supervision.plan_preview import Previews

        try:
            folder = self._ends.enter_context(tempfile.TemporaryDirectory(prefix="merlin_why_"))
            path = Path(folder) / "domain.pddl"
            path.write_text(self._domain, encoding="utf-8")
        except OSError as error:
            raise QuestionError(f"no file can be written for what plans: {error}") from error
        previews = Previews(niceness=NICENESS, while_wanted=while_wanted)
        self._ends.callback(previews.shutdown)
        recorded, (command, named) = self._moment.section(PANEL).get("planner", {}), self._command()
        limits: Dict[str, Any] = {
            name: float(recorded[name]) for name in ("anytime", "time_limit") if name in recorded
        }
        settings = PlannerSettings(command=command if named else "", **limits)

        def look(request: PreviewPlanRequest) -> PreviewPlanResponse:
            problem = problem_of(self._moment, self._moment)
            _add_rest(problem, self._moment, self._moment.at)
            return look_for_plan(request, (self._moment.domain, problem), str(path), settings, previews)

        return look

    def _problems(self) -> Iterator[Problem]:
        """What the plan may have been made for: what was known before it was heard, the latest first."""
        plan = self._moment.section("plan")
        begin = float(plan.get("at") or 0.0) - AROUND
        shown = self._moment
        before: List[Moment] = []
        for look in range(round(2 * AROUND / BETWEEN)):
            then = self._past.at(begin + look * BETWEEN)
            if then is not None and then.section("plan").get("number") == plan.get("number"):
                shown = then  # its goals are there before it, often in the same frame
                break
            before += [] if then is None or then.state in [each.state for each in before] else [then]
        made = float((shown.section(PANEL).get("problem") or {}).get("at", 0.0))
        for each in (*reversed(before), shown):
            with contextlib.suppress(PddlError):  # the monitor began with the plan, and had no objects yet
                problem = problem_of(each, shown)
                _add_rest(problem, shown, made)
                yield problem
        with contextlib.suppress(PddlError):
            for problem in _earlier(shown, begin):
                _add_rest(problem, shown, made)
                yield problem


def _missing(command: str) -> str:
    """What is not as at the robot where a planner's name is run on this computer; empty: nothing."""
    from merlin_rosplan.planning.planner_command import PlannerCommandError
    from merlin_rosplan.planning.planner_engines import engines

    try:
        return engines(command, True).warning or ""
    except PlannerCommandError as error:
        return str(error)


def _add_rest(problem: Problem, moment: Moment, at: float) -> None:
    """Adds the metric, and what comes true by itself.

    :param moment: that has heard of them.
    :param at: ROS time at which the problem begins, s.
    :raises PddlError: they are not of the domain.
    """
    rest = moment.section(PANEL).get("problem")
    if rest is None:
        return
    domain, passed = moment.domain, round((at - rest["at"]) * 1e9)
    objects, timed = " ".join(object_lines(problem, domain)), " ".join(rest["timed"])
    head = f"(define (problem rest) (:domain {domain.name}) (:objects {objects})"
    found = parse_problem(f"{head} (:init {timed}) (:goal (and)) {' '.join(rest['metric'])})", domain)
    problem.metric = found.metric
    problem.timed = [Timed(row.at - passed, row.item) for row in found.timed if row.at > passed]


def _earlier(moment: Moment, since: float) -> Iterator[Problem]:
    """The problems of before each of the last changes of facts, of which not all are in a frame.

    :param since: ROS time, s.
    """
    problem = problem_of(moment, moment)
    recent = moment.section("knowledge").get("recent") or {}
    for number in sorted(recent, key=int, reverse=True):
        change = recent[number]
        if change["at"] < since:
            return
        name, *args = key_of(change["text"])
        if change["kind"] == "facts":
            fact = Fact(name, tuple(args))
            facts = [each for each in problem.facts if each.key != fact.key]
            problem = replace(problem, facts=facts if change["sign"] == "+" else [*facts, fact])
            yield problem


def problem_of(moment: Moment, wanted: Moment) -> Problem:
    """The knowledge of a moment as a problem.

    :param wanted: the moment whose goals it has.
    :raises PddlError: a goal is not one of the domain.
    """
    domain, knowledge = moment.domain, moment.section("knowledge")
    problem = Problem("recorded", domain.name)
    for name, entry in (knowledge.get("objects") or {}).items():
        if name.lower() not in domain.constants:
            problem.objects[name] = (str(entry.get("type", "")),)
    problem.facts = [Fact(name, tuple(args)) for name, *args in map(key_of, knowledge.get("facts") or ())]
    for text, entry in (knowledge.get("values") or {}).items():
        name, *args = key_of(text)
        if entry["value"] is not None:  # it was no finite number
            problem.values.append(FunctionValue(name, tuple(args), float(entry["value"])))
    known = moment.typed()
    asked = [goal for request in wanted.requests for goal in request["goals"]]
    goals = wanted.section("knowledge").get("goals") or asked
    problem.goals = [parse_condition(text, domain, known, "a goal of the recording") for text in goals]
    return problem

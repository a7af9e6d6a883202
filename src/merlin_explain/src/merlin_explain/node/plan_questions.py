# SPDX-License-Identifier: Apache-2.0
"""Questions about plans: what the running system says goes in, an answer comes out."""

import functools
from typing import List, Optional, Sequence, Tuple

from merlin_msgs.msg import DispatchStatus, ExecutorStatus, GoalQueue, PlannerStatus
from merlin_msgs.srv import ExplainRequest
from std_msgs.msg import String

from merlin_explain.claims import Answer, QuestionError
from merlin_explain.core import no_plan as missing_facts
from merlin_explain.core import other_plan
from merlin_explain.core import why as reasons
from merlin_explain.core.causes import Causes
from merlin_explain.core.judge import Judge
from merlin_explain.core.other_plan import Found, Wish
from merlin_explain.core.wording import and_list
from merlin_explain.node.robot_system import RobotSystem
from merlin_pddl.formula import call_text, to_pddl
from merlin_pddl.plan_text import NO_DURATION, PlanStep, parse_line, parse_plan
from merlin_pddl.text_reader import PddlError
from merlin_planning.knowledge_text import to_pddl as item_to_pddl

#: What a planner says when it looked and found nothing; else it did not look.
_NONE = (PlannerStatus.UNSOLVABLE, PlannerStatus.NO_PLAN, PlannerStatus.TIMEOUT)
#: s between the parts of a plan that is put together.
BETWEEN = 0.001


def why(question: ExplainRequest, system: RobotSystem) -> Answer:
    """What a step or a goal of the last plan is there for."""
    _now(question)
    if not question.about:
        raise QuestionError('nothing is asked about; name a step or a goal, "(checked kitchen)"')
    problem = system.latest(f"{system.names.problem}/problem_instance", String)
    plan = system.latest(f"{system.names.planner}/planner_output", String)
    if problem is None or plan is None:
        raise QuestionError("no plan was made yet, so no step of one can be asked about")
    causes = _causes(system.domain_text(), problem.data, plan.data)
    return reasons.why(question.about, causes, _doing(system, causes), system.words())


def why_not(question: ExplainRequest, system: RobotSystem) -> Answer:
    """Why the plan is not another one: it is looked for, and compared."""
    _now(question)
    wish = Wish(question.include, question.without, question.first)
    if not any(wish):
        raise QuestionError("nothing is wished of the other plan; name actions or goals")
    look = _Look(system, _goals(question, system))
    usual = look.plan()
    judge = Judge(system.domain_text(), usual.problem)
    plain = functools.partial(look.plan, include=wish.include, without=wish.without)
    other = _first(wish, look, judge) if wish.first else plain()
    return other_plan.why_not(wish, judge, usual, other, system.words())


def no_plan(question: ExplainRequest, system: RobotSystem) -> Answer:
    """What is missing for goals."""
    _now(question)
    look = _Look(system, _goals(question, system))
    found = look.plan()
    judge = Judge(system.domain_text(), found.problem)
    lacking = missing_facts.Missing([], []) if found.steps is not None else missing_facts.missing(judge)
    then = look.plan(facts=lacking.texts) if lacking.changes else None
    judge_then = Judge(system.domain_text(), then.problem) if then is not None else None
    return missing_facts.no_plan(judge, found, lacking, then, judge_then, system.words())


def what_if(question: ExplainRequest, system: RobotSystem) -> Answer:
    """The plan, were facts and goals others."""
    _now(question)
    words = system.words()
    look = _Look(system, _goals(question, system))
    other = look.plan(facts=question.facts)
    usual = look.plan() if question.facts else None
    judge = Judge(system.domain_text(), other.problem)
    facts = and_list([f"“{words.fact(text)}”" for text in question.facts])
    goals = and_list([f"“{words.goal(text)}”" for text in question.goals])
    changes = " and ".join(filter(None, [facts and f"If {facts} were so", goals and f"for {goals}"]))
    return other_plan.what_if(f"{changes[:1].upper()}{changes[1:]}", judge, usual, other, words)


class _Look:
    """Has the planner interface look for plans, from where the actions that run will have ended."""

    def __init__(self, system: RobotSystem, goals: Sequence[str]) -> None:
        self._goals = list(goals)
        self._system = system
        self._after = _running(system)

    def plan(
        self,
        facts: Sequence[str] = (),
        include: Sequence[str] = (),
        without: Sequence[str] = (),
        goals: Optional[Sequence[str]] = None,
    ) -> Found:
        """A plan.

        :param goals: None: all.
        :raises QuestionError: the planner did not look for one.
        """
        answer = self._system.preview(
            goals=self._goals if goals is None else list(goals),
            facts=list(facts),
            include=list(include),
            without=list(without),
            after=self._after,
        )
        status = answer.status
        reason = status.reason.rstrip(".")
        if status.state in _NONE:
            return Found(None, answer.problem, reason, status.seconds)
        if status.state != PlannerStatus.SOLVED:
            raise QuestionError(reason)
        steps: List[PlanStep] = []
        for text, start, duration in zip(answer.actions, answer.starts, answer.durations):
            step = parse_line(f"{start:.6f}: {text} [{duration or NO_DURATION:.6f}]")
            assert step is not None
            steps.append(step)
        return Found(steps, answer.problem, reason, status.seconds)


def _first(wish: Wish, look: _Look, judge: Judge) -> Found:
    """A plan that reaches some goals first: one for them, and from its end one for all."""
    begin = look.plan(goals=wish.first, include=wish.include, without=wish.without)
    if begin.steps is None:
        return begin
    rest = look.plan(facts=judge.effects(begin.steps), without=wish.without)
    if rest.steps is None:
        return rest
    end = max((step.time + step.duration for step in begin.steps), default=-BETWEEN) + BETWEEN
    steps = [*begin.steps, *(_later(step, end) for step in rest.steps)]
    return Found(steps, begin.problem, "", begin.seconds + rest.seconds)


def _later(step: PlanStep, seconds: float) -> PlanStep:
    return PlanStep(step.time + seconds, step.name, step.arguments, step.duration, step.line)


def _now(question: ExplainRequest) -> None:
    if question.at:
        raise QuestionError(
            "plans can be asked about as they are now, without --at; of the past, --failed and --so answer"
        )


@functools.lru_cache(maxsize=1)
def _causes(domain: str, problem: str, plan: str) -> Causes:
    return Causes(Judge(domain, problem), parse_plan(plan))


def _goals(question: ExplainRequest, system: RobotSystem) -> List[str]:
    """Those that are asked about, else those of the knowledge base."""
    goals = list(question.goals) or [item_to_pddl(item) for item in system.knowledge.goals()]
    if not goals:
        raise QuestionError("there are no goals now; name some, --goal")
    return goals


def _running(system: RobotSystem) -> List[str]:
    """The actions that run, as PDDL text."""
    status = system.latest(f"{system.names.dispatcher}/dispatch_status", DispatchStatus)
    return [
        call_text(action.name, tuple(entry.value for entry in action.parameters))
        for action in (status.running if status is not None else ())
    ]


def _doing(system: RobotSystem, causes: Causes) -> reasons.Doing:
    status = system.latest(f"{system.names.dispatcher}/dispatch_status", DispatchStatus)
    executor = system.latest(f"{system.names.executor}/status", ExecutorStatus)
    queue = system.latest(f"{system.names.executor}/queue", GoalQueue)
    asked: List[Tuple[str, Sequence[str], str, int]] = []
    if executor is not None and executor.request:
        asked.append((executor.request, executor.goals, executor.by, executor.priority))
    if queue is not None:
        asked += [(each.request, each.goals, each.by, each.priority) for each in queue.requests]
    return reasons.Doing(
        status is not None and status.state != DispatchStatus.IDLE,
        _running(system),
        [
            reasons.Request(request, _single(goals, causes.judge), by, priority)
            for request, goals, by, priority in asked
        ],
    )


def _single(goals: Sequence[str], judge: Judge) -> List[str]:
    """Goals as the plan has them: single conditions in small letters."""
    found: List[str] = []
    for goal in goals:
        try:
            found += [to_pddl(each) for each in judge.read(goal)]
        except PddlError:  # of an object that has come since
            found.append(goal)
    return found

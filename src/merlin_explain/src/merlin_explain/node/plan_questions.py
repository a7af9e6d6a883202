# SPDX-License-Identifier: Apache-2.0
"""Questions about plans: what a running or a recorded system says goes in, an answer comes out."""

import dataclasses
import functools
from typing import Any, List, Optional, Protocol, Sequence, Tuple

from merlin_msgs.msg import PlannerStatus
from merlin_msgs.srv import ExplainRequest, PreviewPlanResponse

from merlin_explain.claims import Answer, QuestionError, Words
from merlin_explain.core import no_plan as missing_facts
from merlin_explain.core import other_plan
from merlin_explain.core import why as reasons
from merlin_explain.core.causes import Causes
from merlin_explain.core.judge import Judge
from merlin_explain.core.other_plan import Found, Wish
from merlin_explain.core.wording import and_list
from merlin_pddl.formula import to_pddl
from merlin_pddl.plan_text import NO_DURATION, PlanStep, parse_line, parse_plan
from merlin_pddl.text_reader import PddlError

#: What a planner says when it looked and found nothing; else it did not look.
_NONE = (PlannerStatus.UNSOLVABLE, PlannerStatus.NO_PLAN, PlannerStatus.TIMEOUT)
#: s between the parts of a plan that is put together.
BETWEEN = 0.001


class System(Protocol):
    """What questions about plans ask of a robot that runs, or of one at a recorded moment."""

    def domain_text(self) -> str:
        """Its domain as PDDL."""

    def words(self) -> Words:
        """What its steps and facts are called."""

    def planned(self) -> Tuple[str, str]:
        """The last plan: the problem that it was made for, and its text.

        :raises QuestionError: there is none.
        """

    def doing(self) -> reasons.Doing:
        """What becomes of it."""

    def goals(self) -> List[str]:
        """The goals of the knowledge base as PDDL text."""

    def preview(self, **request: Any) -> PreviewPlanResponse:
        """A plan that is not carried out.

        :param request: fields of ``merlin_msgs/PreviewPlan``.
        """


def of_plans(question: ExplainRequest, system: System) -> Answer:
    """Answers a question about plans.

    :raises QuestionError: it is wrong, or cannot be answered of this system.
    """
    answering = {
        ExplainRequest.WHY: why,
        ExplainRequest.WHY_NOT: why_not,
        ExplainRequest.NO_PLAN: no_plan,
        ExplainRequest.WHAT_IF: what_if,
    }
    return answering[question.question](question, system)


def why(question: ExplainRequest, system: System) -> Answer:
    """What a step or a goal of the last plan is there for."""
    doing = system.doing()
    about = question.about or next(iter(doing.running), "")
    if not about:
        raise QuestionError('nothing runs now; name a step or a goal, "(checked kitchen)"')
    causes = _causes(system.domain_text(), *system.planned())
    asked = [each._replace(goals=_single(each.goals, causes.judge)) for each in doing.requests]
    return reasons.why(about, causes, doing._replace(requests=asked), system.words())


def why_not(question: ExplainRequest, system: System) -> Answer:
    """Why the plan is not another one: it is looked for, and compared."""
    wish = Wish(question.include, question.without, question.first)
    if not any(wish):
        raise QuestionError("nothing is wished of the other plan; name actions or goals")
    look = _Look(system, _goals(question, system))
    usual = look.plan()
    judge = Judge(system.domain_text(), usual.problem)
    plain = functools.partial(look.plan, include=wish.include, without=wish.without)
    other = _first(wish, look, judge) if wish.first else plain()
    return other_plan.why_not(wish, judge, usual, other, system.words())


def no_plan(question: ExplainRequest, system: System) -> Answer:
    """What is missing for goals."""
    look = _Look(system, _goals(question, system))
    found = look.plan()
    judge = Judge(system.domain_text(), found.problem)
    lacking = missing_facts.Missing([], []) if found.steps is not None else missing_facts.missing(judge)
    then = look.plan(facts=lacking.texts) if lacking.changes else None
    judge_then = Judge(system.domain_text(), then.problem) if then is not None else None
    return missing_facts.no_plan(judge, found, lacking, then, judge_then, system.words())


def what_if(question: ExplainRequest, system: System) -> Answer:
    """The plan, were facts and goals others."""
    words = system.words()
    look = _Look(system, _goals(question, system))
    other = look.plan(facts=question.facts)
    usual = look.plan() if question.facts else None
    judge = Judge(system.domain_text(), other.problem)
    facts = and_list([f"“{words.fact(text)}”" for text in question.facts])
    goals = and_list([f"“{words.goal(text)}”" for text in question.goals])
    changes = ", ".join(filter(None, [facts and f"If {facts} were so", goals and f"for {goals}"]))
    return other_plan.what_if(f"{changes[:1].upper()}{changes[1:]}", judge, usual, other, words)


class _Look:
    """Has the planner interface look for plans, from where the actions that run will have ended."""

    def __init__(self, system: System, goals: Sequence[str]) -> None:
        self._goals = list(goals)
        self._system = system
        self._after = list(system.doing().running)

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
    later = [dataclasses.replace(step, time=step.time + end) for step in rest.steps]
    return Found([*begin.steps, *later], begin.problem, "", begin.seconds + rest.seconds)


@functools.lru_cache(maxsize=1)
def _causes(domain: str, problem: str, plan: str) -> Causes:
    return Causes(Judge(domain, problem), parse_plan(plan))


def _goals(question: ExplainRequest, system: System) -> List[str]:
    """Those that are asked about, else those of the knowledge base."""
    goals = list(question.goals) or system.goals()
    if not goals:
        raise QuestionError("there are no goals at that moment; name some, --goal")
    return goals


def _single(goals: Sequence[str], judge: Judge) -> List[str]:
    """Goals as the plan has them: single conditions in small letters."""
    found: List[str] = []
    for goal in goals:
        try:
            found += [to_pddl(each) for each in judge.read(goal)]
        except PddlError:  # of an object that has come since
            found.append(goal)
    return found

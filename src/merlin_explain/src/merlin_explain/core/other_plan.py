# SPDX-License-Identifier: Apache-2.0
"""Why not another plan, and what if: plans that were made for the question, checked and compared."""

from typing import List, NamedTuple, Optional, Sequence

from merlin_explain.claims import EVENT, FACT, GOAL, Answer, Claim, Evidence, QuestionError, Words
from merlin_explain.core.judge import Judge
from merlin_explain.core.wording import and_list, plain, plan_evidence, steps_count
from merlin_pddl.analysis.demand import DONE
from merlin_pddl.analysis.leave_out import ANY
from merlin_pddl.analysis.shortfall import GIVEN_UP, Gap
from merlin_pddl.formula import to_pddl
from merlin_pddl.plan_text import PlanStep

#: Costs and times that differ by less are the same.
SAME = 1e-3


class Found(NamedTuple):
    """What a planner has found.

    :ivar steps: the plan; None: there is none.
    :ivar problem: what was planned, as PDDL text.
    :ivar reason: why there is none.
    :ivar seconds: that it took, wall time.
    """

    steps: Optional[List[PlanStep]]
    problem: str
    reason: str = ""
    seconds: float = 0.0


class Wish(NamedTuple):
    """What the other plan has to be like; see ``merlin_msgs/Explain``."""

    include: Sequence[str] = ()
    without: Sequence[str] = ()
    first: Sequence[str] = ()

    def text(self, words: Words) -> str:
        """``with “…” and without “…”``."""
        parts = (
            ("with", self.include, words.step),
            ("without", self.without, words.step),
            ("that first reaches", self.first, words.goal),
        )
        return and_list(
            [
                f"{what} {and_list([f'“{call(text)}”' for text in texts])}"
                for what, texts, call in parts
                if texts
            ]
        )

    def fault(self, steps: Sequence[PlanStep], judge: Judge) -> str:
        """What of it a plan does not fulfil; empty: nothing."""
        done = {str(step).lower() for step in steps}
        for text in self.include:
            if plain(text) not in done:
                return f"{text} is not in it"
        for text in self.without:
            found = [step for step in steps if _matches(text, step)]
            if found:
                return f"{found[0]} is in it"
        if self.first:
            reached = {to_pddl(goal): at for goal, at in judge.run(steps).reached.items() if at > 0.0}
            wanted = {to_pddl(goal) for text in self.first for goal in judge.read(text)}
            begins = min((at for goal, at in reached.items() if goal not in wanted), default=float("inf"))
            late = [goal for goal in wanted if reached.get(goal, 0.0) > begins]
            if late:
                return f"another goal is reached before {late[0]}"
        return ""


def why_not(wish: Wish, judge: Judge, usual: Found, other: Found, words: Words) -> Answer:
    """Why the plan is not another one.

    :param judge: of the problem.
    :param usual: what the planner finds without the wish.
    :param other: what it finds with it.
    :raises QuestionError: there is nothing to compare, or a plan does not stand a check.
    """
    plan = f"plan {wish.text(words)}"
    goals = [to_pddl(goal) for goal in judge.problem.goals]
    for text in wish.first:
        named = [to_pddl(goal) for goal in judge.read(text)]
        if not named or not set(named) <= set(goals):
            raise QuestionError(f"{text} is not one of the goals, which are {and_list(goals)}")
    if usual.steps is None:
        raise QuestionError(f"there is no plan to compare with: {usual.reason}; `why --no-plan` asks why")
    _check(usual.steps, judge)
    if not wish.fault(usual.steps, judge):
        claim = Claim("plan", "This is the plan that is made now.", (plan_evidence(usual.steps),))
        return Answer(f"The plan that is made now is a {plan} already.", (claim,))
    if other.steps is None:
        return _none(plan, judge, wish, usual.steps, other, words)
    _check(other.steps, judge)
    fault = wish.fault(other.steps, judge)
    if fault:
        raise QuestionError(f"the planner gave no {plan}: {fault}")
    return _compared(plan, judge, usual.steps, other.steps)


def what_if(changes: str, judge: Judge, usual: Optional[Found], other: Found, words: Words) -> Answer:
    """The plan, were facts and goals others.

    :param changes: what would be so, in words.
    :param judge: of the changed problem.
    :param usual: the plan as things are; None: other goals were asked for, so it says nothing.
    :param other: the plan then.
    :raises QuestionError: the plan does not stand a check.
    """
    if other.steps is None:
        gap = judge.gap()
        if gap is None:
            return Answer(f"{changes}, I found no plan {unproved(other)}", (said_by_planner(other),))
        return Answer(f"{changes}, there would be no plan: {cannot(gap, words)}.", (impossible(gap, words),))
    _check(other.steps, judge)
    shown = (plan_evidence(other.steps),)
    claim = Claim("plan", "This would be the plan; nothing of it is carried out.", shown)
    if not other.steps:
        return Answer(f"{changes}, nothing would have to be done.", (claim,))
    sentence = f"{changes}, the plan would have {_size(other.steps)}"
    if usual is None:
        return Answer(f"{sentence}.", (claim,))
    if usual.steps is None:
        return Answer(f"{sentence}; as things are none was found.", (claim, said_by_planner(usual)))
    now = Claim("plan", "This is the plan as things are.", (plan_evidence(usual.steps),))
    same = list(map(str, other.steps)) == list(map(str, usual.steps))
    if same and _size(other.steps) == _size(usual.steps):
        return Answer(f"{changes}, the plan would be the same: {_size(other.steps)}.", (claim, now))
    return Answer(f"{sentence} instead of {_size(usual.steps)}.", (claim, now))


def _check(steps: Sequence[PlanStep], judge: Judge) -> None:
    fault = judge.fault(steps)
    if fault:
        raise QuestionError(f"a plan that was made for the answer does not stand a check: {fault}; ask again")


def unproved(found: Found) -> str:
    """The end of a sentence about a plan that was not found."""
    return f"within {found.seconds:.1f} s; that is no proof that there is none."


def said_by_planner(found: Found) -> Claim:
    """What the planner says when it finds no plan."""
    return Claim("not found", f"The planner says: {found.reason}.", (Evidence(EVENT, found.reason),))


def cannot(gap: Gap, words: Words) -> str:
    """A goal that cannot be reached, and what the nearest way to it lacks, as part of a sentence."""
    goal = to_pddl(gap.goal)
    if goal.startswith(f"({DONE}"):
        said = f"“{words.step(f'({goal[len(DONE) + 1 :]}')}” can never begin"
    else:
        said = f"“{words.goal(goal)}” cannot be reached"
    if gap.why == GIVEN_UP:
        return f"{said}; what comes nearest needs “{words.step(gap.condition)}”"
    return f"{said}; {gap.why}" if gap.condition == goal else f"{said}; what comes nearest lacks {gap.text()}"


def impossible(gap: Gap, words: Words) -> Claim:
    """That a goal cannot be reached."""
    evidence = (Evidence(GOAL, to_pddl(gap.goal)), Evidence(FACT, gap.condition))
    text = cannot(gap, words)
    return Claim("impossible", f"{text}. That is shown without the planner.", evidence)


def _none(
    plan: str, judge: Judge, wish: Wish, usual: Sequence[PlanStep], other: Found, words: Words
) -> Answer:
    now = Claim("plan", "This is the plan that is made now.", (plan_evidence(usual),))
    gap = judge.gap(wish.include, wish.without)
    if gap is None:
        return Answer(f"I found no {plan} {unproved(other)}", (said_by_planner(other), now))
    return Answer(f"There is no {plan}: {cannot(gap, words)}.", (impossible(gap, words), now))


def _compared(plan: str, judge: Judge, usual: Sequence[PlanStep], other: Sequence[PlanStep]) -> Answer:
    ours, theirs = judge.quality(usual), judge.quality(other)
    sizes = f"{_size(other)} instead of {_size(usual)}"
    cost = judge.cost(ours), judge.cost(theirs)
    worse = cost[1] - cost[0]
    judged = judge.judged_by
    if judged:
        sizes += f", {judged} {abs(cost[1]):g} instead of {abs(cost[0]):g}"
    if abs(worse) < SAME:
        sentence = f"A {plan} would be as good: {sizes}."
    elif worse > 0.0:
        sentence = f"A {plan} would be worse: {sizes}."
    else:
        sentence = f"A {plan} would be better: {sizes}. The planner did not find it by itself in its time."
    claims = (
        Claim("plan", f"The plan that is made now: {_size(usual)}.", (plan_evidence(usual),)),
        Claim("plan", f"The other plan: {_size(other)}.", (plan_evidence(other),)),
    )
    return Answer(sentence, claims)


def _size(steps: Sequence[PlanStep]) -> str:
    end = max((step.time + step.duration for step in steps), default=0.0)
    return f"{steps_count(steps)} and {end:.1f} s"


def _matches(pattern: str, step: PlanStep) -> bool:
    words = plain(pattern).strip("()").split()
    names = [step.name.lower(), *(name.lower() for name in step.arguments)]
    return len(words) == len(names) and all(word in (ANY, name) for word, name in zip(words, names))

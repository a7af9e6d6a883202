# SPDX-License-Identifier: Apache-2.0
"""Why a step is in the plan, and why a goal is one."""

from typing import List, NamedTuple, Sequence

from merlin_explain.claims import FACT, GOAL, REQUEST, Answer, Claim, Evidence, QuestionError, Words
from merlin_explain.core.causes import Causes, Link
from merlin_explain.core.wording import and_list, plan_evidence, step_evidence, steps_text
from merlin_pddl.analysis import plan_run
from merlin_pddl.formula import Condition, to_pddl
from merlin_pddl.text_reader import read_expression, suggestion

#: How many links are named.
MOST = 12
_LOGIC = ("and", "or", "not", "imply", "forall", "exists", "=", "<", "<=", ">", ">=")
_WHEN = {"start": "when it begins", "over all": "while it runs", "end": "when it ends"}


class Request(NamedTuple):
    """A request of the Executor.

    :ivar goals: PDDL text.
    :ivar by: person on whose behalf it is, or node that has sent it; empty: not known.
    """

    id: str
    goals: Sequence[str]
    by: str = ""
    priority: int = 0


class Doing(NamedTuple):
    """What becomes of the plan.

    :ivar carried_out: whether a dispatcher carries out a plan now.
    :ivar running: the actions that run, as PDDL text.
    :ivar requests: the one that runs, then those that wait.
    """

    carried_out: bool = False
    running: Sequence[str] = ()
    requests: Sequence[Request] = ()


def why(about: str, causes: Causes, doing: Doing, words: Words) -> Answer:
    """What a step of the plan is there for; or who wants a goal, and what brings it about.

    :param about: PDDL text of an action, or of goals.
    :raises QuestionError: it is neither a step nor a goal of the plan.
    :raises PddlError: it is not PDDL, or names what the domain does not have.
    """
    node = read_expression(about, "the question")
    if node.head in causes.judge.domain.operators:
        return _of_step(_number(about, len(node) - 1, causes), causes, doing, words)
    if node.head not in (*causes.judge.domain.predicates, *_LOGIC):
        known = [*causes.judge.domain.operators, *causes.judge.domain.predicates]
        raise QuestionError(
            f"the domain has neither an action nor a predicate '{node.head}'{suggestion(node.head, known)}"
        )
    goals = causes.judge.read(about)
    for goal in goals:
        if goal not in causes.goals:
            known = [to_pddl(each) for each in causes.goals]
            raise QuestionError(
                f"{to_pddl(goal)} is not a goal of the plan, which has {and_list(known) or 'none'}"
            )
    return _of_goals(goals, causes, doing, words)


def _number(about: str, objects: int, causes: Causes) -> int:
    found = causes.find(about)
    if found:
        return found[0]
    operator = causes.judge.domain.operators[read_expression(about).head]
    if objects != len(operator.parameters):
        labels = " ".join((operator.name, *(parameter.name for parameter in operator.parameters)))
        raise QuestionError(f"{about} has {objects} objects, and the action is ({labels})")
    raise QuestionError(
        f"{about} is not in the plan: {steps_text(causes.steps) or 'it has no steps'}; "
        "`why --not` asks why not"
    )


def _of_step(number: int, causes: Causes, doing: Doing, words: Words) -> Answer:
    step = causes.steps[number]
    name = f"Step {number + 1}, “{words.step(str(step))}”,"
    claims = [_place(number, causes, doing)]
    served, links = causes.goals_served(number), causes.links(number)
    if not links:
        if causes.doubted(number):
            text = "whether it is needed was not found out: two checks of the plan without it disagree."
            return Answer(f"{name[:-1]}: {text}", tuple(claims))
        if not causes.needless(number):
            text = f"{name} cannot be left out, and which later condition needs it was not found."
            return Answer(text, tuple(claims))
        shown = plan_evidence([each for each in causes.steps if each is not step])
        claims.append(Claim("needless", f"Without step {number + 1} all goals are reached, too.", (shown,)))
        text = f"{name} is not needed: without it, the plan reaches all of its goals, too."
        return Answer(text, tuple(claims))
    first = links[0] if links[0].taker == plan_run.GOAL else min(links, key=lambda link: link.taker)
    claims += [_link(link, causes, words) for link in links[:MOST]]
    for goal in served:
        if not any(link.taker == plan_run.GOAL and link.condition == goal for link in links):
            without = f"Without step {number + 1}, and what fails then"
            text = f"{without}, {_quoted(words, goal)} is not reached."
            evidence = (step_evidence(number, causes.steps), Evidence(GOAL, to_pddl(goal)))
            claims.append(Claim("serves", text, evidence))
    asked = _asked(served, doing, words)
    claims += asked
    goals = and_list([_quoted(words, goal) for goal in served])
    sentence = f"{name} is there for {goals or 'no goal'}."
    if first.taker != plan_run.GOAL:
        taker = f"step {first.taker + 1}, “{words.step(str(causes.steps[first.taker]))}”,"
        sentence += f" Without it, “{words.fact(first.text)}” would not hold, which {taker} needs."
    return Answer(" ".join([sentence, *(claim.text for claim in asked[:2])]), tuple(claims))


def _place(number: int, causes: Causes, doing: Doing) -> Claim:
    steps = causes.steps
    plan = "the plan that is carried out" if doing.carried_out else "the plan that was made last"
    runs = str(steps[number]).lower() in {text.lower() for text in doing.running}
    text = f"It is step {number + 1} of {len(steps)} of {plan}{', and runs now' if runs else ''}."
    more = [each + 1 for each in causes.find(str(steps[number])) if each != number]
    if more:
        text += f" The plan has it again as step {and_list(list(map(str, more)))}."
    return Claim("step", text, (step_evidence(number, steps), plan_evidence(steps)))


def _link(link: Link, causes: Causes, words: Words) -> Claim:
    shown = [step_evidence(link.giver, causes.steps)]
    if link.taker == plan_run.GOAL:
        text = f"Without step {link.giver + 1} the goal “{words.goal(link.text)}” is not reached."
        return Claim("link", text, (*shown, Evidence(GOAL, link.text)))
    text = (
        f"Step {link.taker + 1}, “{words.step(str(causes.steps[link.taker]))}”, needs "
        f"“{words.fact(link.text)}” {_WHEN[link.when]}: without step {link.giver + 1} it does not hold."
    )
    shown += [step_evidence(link.taker, causes.steps), Evidence(FACT, link.text)]
    return Claim("link", text, tuple(shown))


def _of_goals(goals: Sequence[Condition], causes: Causes, doing: Doing, words: Words) -> Answer:
    claims = _asked(goals, doing, words)
    sentences = [claim.text for claim in claims[:2]]
    for goal in goals:
        name, shown = _quoted(words, goal), Evidence(GOAL, to_pddl(goal))
        found = causes.achievers(goal)
        if found:
            steps = and_list([str(number + 1) for number in found])
            one = len(found) == 1
            text = f"{f'Step {steps} brings' if one else f'Steps {steps} bring'} {name} about."
            evidence = tuple(step_evidence(number, causes.steps) for number in found)
            claims.append(Claim("achieved", text, (shown, *evidence)))
        elif causes.holds_before(goal):
            text = f"{name} held already when the plan was made."
            claims.append(Claim("held", text, (shown,)))
        else:
            text = f"The plan brings {name} about in more than one way: no single step is needed for it."
            claims.append(Claim("achieved", text, (shown, plan_evidence(causes.steps))))
        sentences.append(text)
    if not doing.requests or not claims or claims[0].kind != "request":
        names = and_list([_quoted(words, goal) for goal in goals])
        text = f"{names} is a goal of the knowledge base, and no request of the Executor names it."
        if not doing.carried_out:
            text = f"The last plan was made for {names}, and no request of the Executor asks for it now."
        sentences.insert(0, text)
    return Answer(" ".join(sentences), tuple(claims))


def _asked(goals: Sequence[Condition], doing: Doing, words: Words) -> List[Claim]:
    """Who has asked for goals."""
    claims = []
    texts = {to_pddl(goal).lower() for goal in goals}
    for request in doing.requests:
        named = [goal for goal in request.goals if goal.lower() in texts]
        if named:
            asker = request.by or "A client of the Executor"
            names = and_list([f"“{words.goal(goal)}”" for goal in named])
            text = f"{asker} asked for {names}, with priority {request.priority}."
            evidence = [Evidence(REQUEST, request.id), *(Evidence(GOAL, goal) for goal in named)]
            claims.append(Claim("request", text, tuple(evidence)))
    return claims


def _quoted(words: Words, goal: Condition) -> str:
    return f"“{words.goal(to_pddl(goal))}”"

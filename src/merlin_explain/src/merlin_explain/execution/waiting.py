# SPDX-License-Identifier: Apache-2.0
"""What a step or a request waits for, and what will end that."""

from typing import Any, List, Mapping, Optional

from merlin_explain.claims import EVENT, FACT, Answer, Claim, Evidence, QuestionError, Words
from merlin_explain.core.wording import and_list
from merlin_explain.execution.moment import (
    RUNNING,
    WAITING,
    Moment,
    Step,
    checked_about,
    key_of,
    matches,
    request_evidence,
)
from merlin_pddl.formula import Condition, to_pddl
from merlin_ros.work.passed_time import clock_text

TOLD = 3  # claims that are part of the sentence


def waiting(moment: Moment, about: str, words: Words) -> Answer:
    """What something waits for.

    :param about: a step, a goal of a request, or its id; empty: what comes next.
    :raises QuestionError: it is neither in the plan nor in the queue.
    """
    request = next((each for each in moment.queue if not about or matches(about, each)), None)
    if about:
        step = None if request else moment.step(checked_about(about))
    else:  # of a plan that is carried out what comes first
        waits = [each for each in moment.steps if each.state == WAITING and moment.executor.get("request")]
        step = waits[0] if waits else None
    if step is not None:
        return _step(moment, step, words)
    if request is not None:
        return _request(moment, request, words)
    if about:
        runs = any(matches(about, each) for each in moment.requests)
        why = "does not wait: its request runs" if runs else "is neither in the plan nor in the queue"
        raise QuestionError(f"{about} {why}; ask what is done")
    held = _held(moment)
    return _answer("The next request", held, 0.0) if held else Answer("Nothing waits.")


# --- a step -----------------------------------------------------------------------------------------------


def _step(moment: Moment, step: Step, words: Words) -> Answer:
    what = f"“{words.step(step.text)}”"
    if step.state in RUNNING:
        return Answer(f"{what} does not wait: it {_going(moment, step)}.")
    if step.state != WAITING:
        return Answer(f"{what} does not wait: it has {step.state}.")
    claims = [*_breakpoint(moment, step), *_robot(moment, step), *_before(moment, step, words)]
    for unmet in moment.unmet(step):
        claims += _condition(moment, step, unmet, claims, words)
    return _answer(what, claims, float(moment.section("plan").get("at") or 0.0))


def _breakpoint(moment: Moment, step: Step) -> List[Claim]:
    held = str(moment.executor.get("held") or "")
    if key_of(held) != key_of(step.text):
        return []
    text = "it is held at a breakpoint, until it is let go on"
    return [Claim("held", text, (Evidence(EVENT, f"held before {held}", time=moment.at),))]


def _robot(moment: Moment, step: Step) -> List[Claim]:
    """Its robot, when that takes no actions."""
    robots = moment.section("robots")
    robot = moment.objects_of(step).get(str((robots.get("parameters") or {}).get(step.name)), "")
    away = ((robots.get("robots") or {}).get(robot) or {}).get("away")
    if not away:
        return []
    text = f"robot {robot} takes no actions: {away}"
    return [Claim("robot", text, (Evidence(EVENT, text, time=moment.at),))]


def _before(moment: Moment, step: Step, words: Words) -> List[Claim]:
    """The steps that have to end or to begin first, and, behind those that wait, those that run."""
    claims: List[Claim] = []
    seen, level = {step.key}, [step]
    while level:
        pairs = [(each, *found) for each in level for found in moment.before(each)]
        level = []
        for each, first, has_to_end in pairs:
            waits = first.state == WAITING
            if first.key in seen or not (waits or (has_to_end and first.state in RUNNING)):
                continue
            seen.add(first.key)
            level += [first] if waits else []
            if each is step or not waits:
                how = (
                    "comes before it, and has not begun"
                    if waits
                    else f"has to end first, it {_going(moment, first)}"
                )
                shown = (first.evidence(), each.evidence())
                claims.append(Claim("order", f"“{words.step(first.text)}” {how}", shown))
    return claims


def _going(moment: Moment, step: Step) -> str:
    """Since when a step runs, and when it ends as planned."""
    began = f"has run since {clock_text(step.began)}" if step.began is not None else "runs"
    if step.due is None:
        return f"{began}; how long it takes is not planned"
    if step.due < moment.at:
        return f"{began} and is {moment.at - step.due:.0f} s over its planned {step.duration:.0f} s"
    return f"{began} and as planned ends at {clock_text(step.due)}"


def _condition(
    moment: Moment, step: Step, unmet: Condition, before: List[Claim], words: Words
) -> List[Claim]:
    """A condition that does not hold, and what will make it true.

    :param before: claims that come before these.
    """
    text, evidence = to_pddl(unmet), moment.condition_evidence(unmet)
    claims = [Claim("condition", f"“{words.fact(text)}” does not hold", evidence)]
    bringer = _bringer(moment, step, unmet)
    timed = [each for each in moment.timed if key_of(each.text) == key_of(text) and each.at > moment.at]
    if bringer is not None:
        when = f", it {_going(moment, bringer)}" if bringer.state in RUNNING else " and has not begun"
        known = any(bringer.evidence() in claim.evidence for claim in before)
        what = f"“{words.step(bringer.text)}” will make it true{'' if known else when}"
        claims.append(Claim("bringer", what, (bringer.evidence(), *evidence)))
    elif timed:
        due = min(timed, key=lambda each: each.at)
        fact = Evidence(FACT, due.text, 0, moment.version, due.at)
        claims.append(Claim("timed", f"it comes true by itself at {clock_text(due.at)}", (fact,)))
    return claims


def _bringer(moment: Moment, step: Step, unmet: Condition) -> Optional[Step]:
    """A step whose effect makes a condition true, one that runs before one that waits."""
    found = [each for each in moment.steps if each.key != step.key and moment.brings(each, unmet)]
    running = [each for each in found if each.state in RUNNING]
    return next(iter([*running, *(each for each in found if each.state == WAITING)]), None)


# --- a request --------------------------------------------------------------------------------------------


def _request(moment: Moment, request: Mapping[str, Any], words: Words) -> Answer:
    claims = _held(moment)
    not_before = float(request.get("not_before") or 0.0)
    if not_before > moment.at:
        shown = request_evidence(request, not_before)
        claims.append(Claim("time", f"it may not begin before {clock_text(not_before)}", (shown,)))
    claims += _ahead(moment, request, words)
    expected = float(request.get("expected_begin") or 0.0)
    if claims and expected > moment.at:
        text = f"it is expected to begin at {clock_text(expected)}, if all goes as planned"
        claims.append(Claim("estimate", text, (request_evidence(request, expected),)))
    return _answer(_goals(request, words), claims, float(request.get("queued") or 0.0))


def _held(moment: Moment) -> List[Claim]:
    """What keeps every request from beginning, from the Executor's status."""
    executor = moment.executor
    held = "" if executor.get("request") else executor.get("held")
    reasons = {
        "guard": executor.get("waits") or "",
        "held": f"a breakpoint holds “{held}” until it is let go on" if held else "",
        "paused": "the robot is paused until it is resumed" if executor.get("paused") else "",
    }
    return [
        Claim(kind, text, (Evidence(EVENT, f"merlin/status: {text}", time=moment.at),))
        for kind, text in reasons.items()
        if text
    ]


def _ahead(moment: Moment, request: Mapping[str, Any], words: Words) -> List[Claim]:
    """The request that runs, and those that come first."""
    executor, claims = moment.executor, []
    if executor.get("request"):
        end = float(executor.get("expected_end") or 0.0)
        when = f", expected at {clock_text(end)}" if end > moment.at else ""
        first = executor["priority"] >= request["priority"]
        kept = "cannot be interrupted now" if request.get("kept") else "is being stopped"
        how = f"has to end first{when}" if first else f"is less urgent, and {kept}"
        goals = _goals({"goals": [goal for each in moment.requests for goal in each["goals"]]}, words)
        shown = tuple(request_evidence(each, end) for each in moment.requests)
        claims.append(Claim("request", f"{goals} {how}", shown))
    for other in moment.queue:
        if other["request"] == request["request"]:
            break
        why = "is more urgent" if other["priority"] > request["priority"] else "was there first"
        text = f"{_goals(other, words)} comes first: it {why}"
        claims.append(Claim("request", text, (request_evidence(other),)))
    return claims


def _goals(request: Mapping[str, Any], words: Words) -> str:
    return f"“{and_list([words.goal(goal) for goal in request['goals']])}”"


def _answer(what: str, claims: List[Claim], since: float) -> Answer:
    if not claims:
        return Answer(f"{what} has not begun, and nothing is known to keep it.")
    reasons = "; ".join(claim.text for claim in claims[:TOLD])
    waits = f"has waited since {clock_text(since)}" if since else "waits"
    return Answer(f"{what} {waits}: {reasons}.", tuple(claims))

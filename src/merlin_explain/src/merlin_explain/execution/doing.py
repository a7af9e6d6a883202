# SPDX-License-Identifier: Apache-2.0
"""What is done at a moment, and when it ends: the estimate, and what it rests on."""

from typing import List

from merlin_explain.claims import EVENT, Answer, Claim, Evidence, Words
from merlin_explain.execution.moment import RUNNING, SHORTEST, Moment, matches, request_evidence
from merlin_explain.execution.waiting import waiting
from merlin_ros.work.passed_time import clock_text


def doing(moment: Moment, about: str, words: Words) -> Answer:
    """What is done, and when that is expected to end; of a request that waits, when it begins.

    :param about: a goal of a request; empty: what runs.
    :raises QuestionError: nothing that runs or waits has this goal.
    """
    now, executor = moment.section("now"), moment.executor
    if about and not any(matches(about, each) for each in moment.requests):
        return waiting(moment, about, words)
    what = str(now.get("doing") or "nothing is known of what is done")
    said = f"{what} {now.get('because') or ''}".strip()
    claims = [Claim("doing", what, (Evidence(EVENT, said, time=moment.at),))]
    for step in moment.steps:
        if step.state in RUNNING:
            runs = "runs" if step.began is None else f"has run since {clock_text(step.began)}"
            claims.append(Claim("running", f"“{words.step(step.text)}” {runs}", (step.evidence(),)))
    estimate = _estimate(moment) if executor.get("request") else []
    sentences = [said, *(["; ".join(claim.text for claim in estimate)] if estimate else [])]
    return Answer(" ".join(f"{each[:1].upper()}{each[1:]}." for each in sentences), (*claims, *estimate))


def _estimate(moment: Moment) -> List[Claim]:
    """When the plan ends, and how sure that is."""
    executor = moment.executor
    end, deadline = (float(executor.get(name) or 0.0) for name in ("expected_end", "deadline"))
    shown = (request_evidence(executor, end),)
    if not end:
        why = "its plan has no durations" if moment.steps else "there is no plan yet"
        return [Claim("estimate", f"when it ends is not known: {why}", shown)]
    claims = [Claim("estimate", f"it is expected to end at {clock_text(end)}", shown)]
    if end <= moment.at:
        claims.append(Claim("sureness", f"that was {moment.at - end:.0f} s ago: it is late", shown))
    else:
        claims.append(_pace(moment, end - moment.at))
    if deadline and end > deadline:
        claims.append(Claim("late", f"that is after its deadline {clock_text(deadline)}", shown))
    return claims


def _pace(moment: Moment, left: float) -> Claim:
    """What the steps that have ended say of an estimate.

    :param left: s until the end that is expected.
    """
    paces = {
        step: (step.ended - step.began) / step.duration
        for step in moment.steps
        if step.state == "succeeded" and step.duration > SHORTEST and step.began and step.ended
    }
    if not paces:
        shown = (request_evidence(moment.executor),)
        return Claim("sureness", "no step of its plan has ended yet, so it rests on the plan alone", shown)
    least, most = min(paces.values()), max(paces.values())
    count = f"{len(paces)} steps have" if len(paces) > 1 else "one step has"
    taken = f"{least:.1f}" if f"{least:.1f}" == f"{most:.1f}" else f"{least:.1f} to {most:.1f}"
    first, last = (clock_text(moment.at + left * pace) for pace in (least, most))
    ends = f"at {first}" if first == last else f"between {first} and {last}"
    text = f"{count} taken {taken} times the planned time; at that pace it ends {ends}"
    return Claim("sureness", text, tuple(step.evidence() for step in paces))

# SPDX-License-Identifier: Apache-2.0
"""Judges what answers: the stop, the nodes at their ports, the page."""

from typing import List

from chaos.faults import PAGE_STOP
from chaos.judging import events
from chaos.judging.evidence import Evidence

#: s in which `merlin/stop` is answered, by the ticks of the one who asks.
STOP_LIMIT = 0.5
#: s in which the page has an operator's stop confirmed: the guard's own limit of 1 s twice, and the way.
PAGE_LIMIT = 3.0
#: s in which the guard's own word may still be under way to the witness.
GRACE = 0.25
#: The guard's state when it holds the base until its release.
HELD = 3


def the_stop_is_answered(evidence: Evidence) -> List[str]:
    """`merlin/stop` is answered in time, and the base can be released."""
    found = []
    for event in evidence.log:
        if event.kind == events.STOPPED:
            at = evidence.when(event["asked"])
            late = event["ticks"] > STOP_LIMIT and event.at > evidence.deadline(event["asked"], STOP_LIMIT)
            if event["error"]:
                found.append(f"merlin/stop, asked at {at}, is not answered: {event['error'][:120]}")
            elif late:
                found.append(f"merlin/stop, asked at {at}, is answered only after {event['ticks']:.2f} s")
        if event.kind == events.RELEASED and event["error"]:
            found.append(f"the base is not released at {evidence.when(event.at)}: {event['error'][:120]}")
    return found


def every_node_answers(evidence: Evidence) -> List[str]:
    """A node that runs can be reached at both of its ports; one that does not run has a rule of its own."""
    missing = [event["nodes"] for event in evidence.log if event.kind == events.MISSING]
    gone = {node for nodes in missing for node in nodes}
    return [
        f"{event['node']} runs, and does not answer at {evidence.when(event.at)}: {event['error'][:120]}"
        for event in evidence.log
        if event.kind == events.PROBED and event["error"] and event["node"] not in gone
    ]


def what_the_page_says_is_true(evidence: Evidence) -> List[str]:
    """A stop on the page is confirmed, and each robot's guard holds from then on until the release."""
    trial = evidence.trial
    if trial.fault.kind != PAGE_STOP:
        return []
    asked = [event for event in evidence.log if event.kind == events.PAGE and event["what"] == "stop"]
    if not asked or asked[0]["status"] != 200:
        said = f"{asked[0]['status']} {asked[0]['words'][:160]}" if asked else "nothing"
        return [f"a stop on the page is not confirmed: {said}"]
    answer, found = asked[0], []
    if answer.at > evidence.deadline(answer["asked"], PAGE_LIMIT):
        found.append(f"the page confirms a stop only after {answer.at - answer['asked']:.1f} s")
    for robot in trial.variant.robots or ("",):
        mine = evidence.of_robot(robot)
        until = answer.at + GRACE
        before = [event for event in mine.log if event.kind == events.GUARD and event.at <= until]
        guard = f"the guard of {robot}" if robot else "the guard"
        if not before or before[-1]["state"] != HELD:
            found.append(f"the page says '{answer['words'][:60]}', and {guard} does not hold the base")
    return found

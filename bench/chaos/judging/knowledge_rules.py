# SPDX-License-Identifier: Apache-2.0
"""Judges what the knowledge base says in a trial: one true place, nothing lost, nothing left over."""

from typing import List

from chaos.judging import events
from chaos.judging.events import Event
from chaos.judging.evidence import Evidence, places_of, settled
from chaos.judging.scene import scene_at

#: s from the first look until the knowledge is as it is between two requests.
FACTS_LIMIT = 5.0
#: m within which the robot is at a point of interest.
NEAR = 0.5
#: The file that the knowledge base keeps its facts in.
STATE_FILE = "knowledge.sqlite"


def one_true_place(evidence: Evidence) -> List[str]:
    """Exactly one robot_at holds, and it agrees with where the robot is."""
    found = []
    for facts in _looks(evidence):
        at = evidence.when(facts.at)
        if "error" in facts.data:
            found.append(f"the knowledge base does not answer at {at}: {facts['error'][:120]}")
            continue
        for robot in evidence.trial.variant.robots or ("",):
            found += _place(evidence.of_robot(robot), facts, robot)
    return found


def _place(evidence: Evidence, facts: Event, robot: str) -> List[str]:
    at, places = evidence.when(facts.at), places_of(facts, robot)
    if len(places) != 1:
        of = f" for {robot}" if robot else ""
        return [f"{len(places)} robot_at hold{of} at {at}: {', '.join(places) or 'none'}"]
    truth = scene_at(evidence.log, facts.at).truth
    point = evidence.points.get(places[0])
    if truth is None or point is None:
        return []
    off = ((truth["x"] - point[0]) ** 2 + (truth["y"] - point[1]) ** 2) ** 0.5
    if off <= NEAR:
        return []
    return [
        f"(robot_at {places[0]}) holds at {at}, but {robot or 'the robot'} is {off:.1f} m away from there"
    ]


def nothing_is_lost(evidence: Evidence) -> List[str]:
    """Facts that were acknowledged are still there; goals of ended requests are not."""
    found = []
    for facts in (
        event for event in evidence.log if event.kind == events.FACTS and "error" not in event.data
    ):
        lost = sorted(set(evidence.notes) - set(facts["notes"]))
        if lost:
            found.append(f"acknowledged facts are lost at {evidence.when(facts.at)}: {', '.join(lost)}")
        if facts["goals"] and facts in _looks(evidence):
            found.append(f"goals are left at {evidence.when(facts.at)}: {', '.join(facts['goals'])}")
    return found


def what_is_full_is_said(evidence: Evidence) -> List[str]:
    """A knowledge base that refuses a fact because its disk is full says which file it is."""
    refused = next((event for event in evidence.log if event.kind == events.WRITTEN and event["error"]), None)
    if refused is None:
        return []
    said = [event["text"] for event in evidence.all(events.SAID, evidence.zero, evidence.end)]
    if any(STATE_FILE in text and "full" in text for text in said):
        return []
    heard = f"'{said[0][:120]}'" if said else "nothing"
    return [
        f"{refused['fact']} is refused at {evidence.when(refused.at)}, and no node says that the disk of "
        f"{STATE_FILE} is full; said: {heard}"
    ]


def _looks(evidence: Evidence) -> List[Event]:
    """The looks at the knowledge that count: what is being restarted may settle its knowledge first."""
    before, robots = evidence.looks_before_next(), evidence.trial.variant.robots
    bad = next((number for number, facts in enumerate(before) if settled(facts, robots)), len(before))
    in_time = bad < len(before) and before[bad].at <= evidence.deadline(before[0].at, FACTS_LIMIT)
    excused = before[: bad if in_time else max(0, bad - 1)]
    return [event for event in evidence.log if event.kind == events.FACTS and event not in excused]

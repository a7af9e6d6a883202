# SPDX-License-Identifier: Apache-2.0
"""One trial: two goals, one fault at a random moment, and what must hold afterwards."""

import random
import time
from typing import Dict, List, NamedTuple, Optional

from fleet.faults import FAULTS, FOR_EVER
from fleet.system import Fleet, Late, drawn_goals, first_owner_after
from merlin_fleet.fleet_client import ACHIEVED

GOALS = 2


class Row(NamedTuple):
    """What a trial has shown."""

    number: int
    fault: str
    victim: str
    moment: float
    """s from the first begin of a goal to the fault."""
    finish: bool
    lost: int
    """Goals that have not ended."""
    twice: int
    """Goals that two robots executed at once."""
    again: int
    """Goals that were done again, because their first end could not be reported."""
    failed: int
    """Goals that have ended, and do not hold."""
    forgotten: int
    """Ends that the hub had taken, and that are no longer there."""
    next_owner: Optional[float]
    """s from the fault until another robot had the goals of the victim; None: it was not needed."""
    back: Optional[float]
    """s from the end of the fault until every goal had ended and all robots were there; None: never."""
    note: str


def run_trial(fleet: Fleet, number: int, name: str, chance: random.Random) -> Row:
    """Runs one.

    :raises Late: when the fleet was not ready for it.
    """
    fault = FAULTS[name]
    _prepare(fleet)
    goals, finish = drawn_goals(chance, GOALS), chance.random() < 0.2
    notes: List[str] = []
    requests = fleet.send(goals, tries=len(fleet.robots), finish=finish)
    fleet.until(fleet.running, "a robot works")
    moment = chance.uniform(0.0, fleet.drive)
    fleet.pause(moment)
    victim = chance.choice(fleet.running() or sorted(fleet.robots))
    owned = [request.id for request in requests if request.news and request.news.owner == victim]
    at = time.monotonic()
    fault.begin(fleet, victim)

    def over() -> bool:
        return all(request.done for request in requests)

    back: Optional[float] = None
    try:
        if fault.lasts != FOR_EVER:
            fleet.pause(fault.lasts)
        elif not finish:  # such goals wait for their robot
            fleet.until(over, "every goal has ended")
    except Late as late:
        notes.append(str(late))
    taken = {request.id: request.result.outcome for request in requests if request.result is not None}
    fault.end(fleet, victim)
    ended = time.monotonic()
    try:
        fleet.until(over, "every goal has ended after the fault")
        fleet.until(lambda: not fleet.running(), "all robots stand")
        fleet.until(lambda: fleet.joined() == set(fleet.robots), "all robots are in the fleet again")
        back = time.monotonic() - ended
    except Late as late:
        notes.append(str(late))
    ends = {request.id: request.result.outcome if request.result else "" for request in requests}
    done = {goal: fleet.ledger.times_done(goal) for goal in goals}
    outcomes = {goal: ends[request.id] for goal, request in zip(goals, requests)}
    twice = fleet.ledger.overlaps
    lost = [goal for goal in goals if not outcomes.get(goal)]
    lost += [goal for goal, outcome in outcomes.items() if outcome == "SUCCEEDED" and not done[goal]]
    return Row(
        number,
        name,
        victim,
        round(moment, 2),
        finish,
        len(lost),
        len(twice),
        sum(max(0, times - 1) for times in done.values()),
        sum(bool(outcome) and outcome not in ACHIEVED for outcome in outcomes.values()),
        sum(ends.get(goal) != outcome for goal, outcome in taken.items()),
        _next_owner(fleet, owned, at, victim) if fault.takes_over and not finish else None,
        None if back is None else round(back, 2),
        "; ".join([*notes, *twice, *(f"{goal} was lost" for goal in lost), *_unusual(outcomes)]),
    )


def _unusual(outcomes: Dict[str, str]) -> List[str]:
    return [f"{goal}: {outcome}" for goal, outcome in outcomes.items() if outcome not in ACHIEVED]


def _next_owner(fleet: Fleet, owned: List[str], at: float, victim: str) -> Optional[float]:
    """The longest of the victim's goals; one that it could end itself needs no other owner."""
    times = [first_owner_after(fleet.seen, goal, at, victim) for goal in owned]
    found = [time_ - at for time_ in times if time_ is not None]
    return round(max(found), 2) if found else None


def _prepare(fleet: Fleet) -> None:
    """All robots are in the fleet, idle, and know of no checked room."""
    fleet.until(lambda: fleet.joined() == set(fleet.robots), "all robots are in the fleet")
    fleet.until(lambda: not fleet.running(), "all robots stand")
    fleet.forgetful.clear()
    for robot in fleet.robots.values():
        robot.forget()
    fleet.until(lambda: fleet.forgetful == set(fleet.robots), "all robots have forgotten what is checked")

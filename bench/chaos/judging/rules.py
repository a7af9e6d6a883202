# SPDX-License-Identifier: Apache-2.0
"""Judges a trial: takes its events in the order of time, and says what must not have happened.

Each rule returns sentences that say what was seen and when, in s since the fault. No rule means no violation.
"""

import math
import re
from dataclasses import dataclass
from typing import Callable, List, Optional, Set, Tuple

from chaos.faults import AGAIN, CANCEL_AHEAD, CLIENT, MASTER
from chaos.judging import events
from chaos.judging.answer_rules import (
    every_node_answers,
    the_stop_is_answered,
    what_the_page_says_is_true,
)
from chaos.judging.events import Event
from chaos.judging.evidence import (
    JOINED,
    NEXT,
    REQUEST,
    Evidence,
    action_began,
    stood_at,
    used_by_others,
    way,
    world_time,
)
from chaos.judging.joined_rules import each_ends_for_itself, what_has_succeeded_holds
from chaos.judging.knowledge_rules import nothing_is_lost, one_true_place, what_is_full_is_said
from chaos.judging.scene import CANCEL_ACTION, IDLE, commands_motion, scene_at, stands
from chaos.moments import Moment

#: s after which the clients of a server that hangs have given it up.
GIVEN_UP = 7.0
#: s from the loss of an owner until the base stands.
STAND_LIMIT = 1.0
#: The same when the owner is not dead, but hung or cut off.
STAND_LIMIT_HUNG = 1.5
#: The same without a master: 5 s to notice, and a second.
STAND_LIMIT_MASTER = 6.0
#: s after a request's end in which messages of before may still arrive.
END_GRACE = 0.25
#: s until the plan for the others is known, behind which what runs for one that leaves them stops.
LEAVE_LIMIT = 2.0
#: s of simulated time after a request's end in which a base that was commanded to stop may brake: 1 rad/s at
#: 2 rad/s² takes 0.5; the rest is the age of the truth that the end is seen with, and the command's way.
BRAKING = 0.75
#: s from a cancel, or from a fault that ends the request, until the client gets the result.
ANSWER_LIMIT = 10.0
#: The same when only a planner has to end, whatever it does: nothing it writes delays a cancel.
ANSWER_LIMIT_PLANNER = 2.0
#: s from an end until the first action of the next goal begins.
NEXT_LIMIT = 5.0
#: The same when a process had to be started by hand first.
NEXT_LIMIT_HELPED = 10.0
#: s without an action, from the first kill of what dies again and again until the request has ended: 8 s for
#: its return, counted once, and what is planned and called between the kills.
RETURN_LIMIT = 12.0
#: s without anything that runs after which a request hangs.
SILENT = 5.0
#: Outcomes that need no reason.
GOOD = ("SUCCEEDED", "ALREADY_TRUE")

_ERRNO = re.compile(r"\[Errno -?\d+\]|Traceback|object has no attribute")
#: What no true reason says here: a campaign's robot has one client.
_OTHERS = re.compile(r"(recalled|preempted|cancelled) by another client")


@dataclass(frozen=True)
class Judgement:
    """What a trial showed.

    :param violations: sentences; none is good.
    :param stand: s from the fault until the base stood; None when it stood already, or never did.
    :param answer: s from the fault, or from the cancel when that came later, until the client was told.
    :param following: s until the next goal's first action began.
    :param outcome: of the request.
    :param stopping: s until `merlin/stop` was answered, by the ticks of the one who asked; None: it was not.
    """

    violations: Tuple[str, ...]
    stand: Optional[float]
    answer: Optional[float]
    following: Optional[float]
    outcome: str
    stopping: Optional[float] = None


def judge(evidence: Evidence) -> Judgement:
    """Applies all rules."""
    violations = [sentence for rule in RULES for sentence in rule(evidence)]
    ended = evidence.first(events.ENDED, REQUEST)
    following, began = evidence.first(events.NEXT), action_began(evidence)
    asked = evidence.first(events.CANCEL, REQUEST, evidence.zero)
    stopped = evidence.first(events.STOPPED)
    answer = None
    if ended is not None and ended.at >= evidence.zero:
        # A request that went on until it was cancelled later is answered from the cancel on.
        begin = asked.at if asked is not None and asked.at <= ended.at else evidence.zero
        answer = max(0.0, ended.at - begin)
    return Judgement(
        tuple(violations),
        stand=seconds_to_stand(evidence),
        answer=answer,
        following=began.at - following.at if began is not None and following is not None else None,
        outcome=ended["outcome"] if ended is not None else "",
        stopping=stopped["ticks"] if stopped is not None and not stopped["error"] else None,
    )


def seconds_to_stand(evidence: Evidence) -> Optional[float]:
    """s from the fault until the base stood; None when it stood already, never did, or need not stand."""
    trial = evidence.trial
    if scene_at(evidence.log, evidence.zero).standing or not (trial.fault.takes_owner or trial.cancel):
        return None
    stood = stood_at(evidence, evidence.zero)
    return None if stood is None else stood - evidence.zero


def base_stands(evidence: Evidence) -> List[str]:
    """The base of each robot stands soon after a drive has lost an owner, or was stopped or cancelled."""
    return [
        sentence
        for robot in evidence.trial.variant.robots or ("",)
        for sentence in _stands(evidence.of_robot(robot), f"the base of {robot}" if robot else "the base")
    ]


def _stands(evidence: Evidence, base: str) -> List[str]:
    trial = evidence.trial
    if scene_at(evidence.log, evidence.zero).standing:
        return []
    if not (trial.fault.takes_owner or trial.cancel):
        return []
    limit = STAND_LIMIT_HUNG if trial.fault.hangs or not trial.fault.takes_owner else STAND_LIMIT
    if trial.fault.targets == (MASTER,) and not trial.cancel:
        limit = STAND_LIMIT_MASTER
    if trial.joined and not trial.fault.takes_owner:
        limit += LEAVE_LIMIT
    stood = stood_at(evidence, evidence.zero)
    deadline = evidence.deadline(evidence.zero, limit)
    if stood is not None and stood - _slow_braking(evidence, stood) <= deadline:
        return []
    if stood is None and evidence.end <= deadline:
        return []
    until = stood if stood is not None else evidence.end
    metres = way(evidence, evidence.zero, until)
    if stood is None:
        after = f"{evidence.when(until)} after the fault, {metres:.1f} m further"
        return [f"{base} drives on, or would: no stop within {after}"]
    after = f"{evidence.when(stood)} after the fault (limit {limit:g} s), {metres:.1f} m further"
    return [f"{base} stands only {after}"]


def _slow_braking(evidence: Evidence, stood: float) -> float:
    """s that a slow simulated world has added to the base's braking."""
    braking = max(evidence.zero, stood - 2 * BRAKING)
    slow = (stood - braking) - (world_time(evidence, stood) - world_time(evidence, braking))
    return max(0.0, slow)


def no_motion_after_the_end(evidence: Evidence) -> List[str]:
    """Once a request has ended, nothing moves, and nothing asks for motion."""
    found = []
    ends = [event for event in evidence.log if event.kind == events.ENDED]
    for ended in ends:
        sent = evidence.first(events.SENT, after=ended.at)
        begin, end = evidence.deadline(ended.at, END_GRACE), sent.at if sent is not None else evidence.end
        if evidence.trial.moment is Moment.IDLE and ended.get("label") == REQUEST:
            continue
        if "move_base" in used_by_others(evidence, ended):
            continue
        braked = world_time(evidence, ended.at) + BRAKING
        moving = [
            event
            for event in evidence.all(events.TRUTH, begin, end)
            if not stands(event) and event.get("ros", event.at) > braked
        ]
        asked = [event for event in evidence.all(events.COMMAND, begin, end) if commands_motion(event)]
        name = "the next request" if ended["label"] == NEXT else "the request"
        if moving:
            metres = way(evidence, begin, moving[-1].at)
            found.append(
                f"{name} ended ({ended['outcome']}) at {evidence.when(ended.at)}, and the base moves until "
                f"{evidence.when(moving[-1].at)}, {metres:.1f} m"
            )
        elif asked:
            found.append(
                f"{name} ended ({ended['outcome']}) at {evidence.when(ended.at)}, and cmd_vel is not zero "
                f"until {evidence.when(asked[-1].at)}"
            )
    return found


def the_end_is_reported(evidence: Evidence) -> List[str]:
    """The client gets the result in time, and a request that has not ended does something."""
    trial, found = evidence.trial, []
    for label in (REQUEST, *JOINED, NEXT):
        asked = evidence.first(events.CANCEL, label)
        if asked is None or (label != NEXT and CLIENT in trial.fault.targets and trial.fault.lasts is None):
            continue
        ended = evidence.first(events.ENDED, label)
        begin = max(asked.at, evidence.zero) if label == REQUEST else asked.at
        name = "the next request, cancelled," if label == NEXT else "a cancelled request"
        limit = ANSWER_LIMIT_PLANNER if trial.variant.planner else ANSWER_LIMIT
        deadline = evidence.deadline(begin, limit)
        if ended is None and evidence.end > deadline:
            found.append(f"{name} has not ended {evidence.end - begin:.1f} s after its cancel: it hangs")
        elif ended is not None and ended.at > deadline:
            found.append(f"{name} ended ({ended['outcome']}) only {ended.at - begin:.1f} s after its cancel")
    return found + _hangs(evidence) + _outlives_its_client(evidence)


def the_end_is_true(evidence: Evidence) -> List[str]:
    """The client's result agrees with the world."""
    found = []
    for ended in (event for event in evidence.log if event.kind == events.ENDED):
        outcome, reason = ended["outcome"], ended["reason"]
        at = evidence.when(ended.at)
        if outcome == "CANCELLED":
            found += _cancelled_truly(evidence, ended)
        if outcome == "CANCEL_TIMEOUT" and not (ended["action"] or reason):
            found.append(f"CANCEL_TIMEOUT at {at} does not name what did not stop")
        if outcome not in (*GOOD, "CANCELLED", "CANCEL_TIMEOUT") and not reason:
            found.append(f"{outcome} at {at} without a reason")
        if _ERRNO.search(reason):
            found.append(f"{outcome} at {at} with a reason that names no part: '{reason[:120]}'")
        foreign = evidence.trial.fault.kind == CANCEL_AHEAD and ended["label"] == REQUEST
        if _OTHERS.search(reason) and not foreign:
            found.append(f"{outcome} at {at} blames a client that there is not: '{reason[:120]}'")
    return found


def no_process_is_left(evidence: Evidence) -> List[str]:
    """What a planner has started ends with it."""
    return [
        f"{event['count']} processes of the planner are left at {evidence.when(event.at)}"
        for event in evidence.log
        if event.kind == events.LEFT and event["count"]
    ]


def every_node_is_back(evidence: Evidence) -> List[str]:
    """What has died runs again at the end, also where the next goal does not need it."""
    return [
        f"{', '.join(event['nodes'])} does not run at the end of the trial, {evidence.when(event.at)}"
        for event in evidence.log
        if event.kind == events.MISSING and event["nodes"]
    ]


def the_next_goal_works(evidence: Evidence) -> List[str]:
    """The next goal begins in time, without help."""
    ready = evidence.first(events.NEXT)
    if ready is None:
        return []
    began, ended = action_began(evidence), evidence.first(events.ENDED, NEXT)
    helped = evidence.first(events.HELPED)
    limit = NEXT_LIMIT_HELPED if helped is not None else NEXT_LIMIT
    deadline = evidence.deadline(max([ready.at, *(look.at for look in evidence.looks_before_next())]), limit)
    cancelled = evidence.first(events.CANCEL, NEXT)
    by_itself = ended is not None and (cancelled is None or ended.at < cancelled.at)
    if ended is not None and by_itself and ended["outcome"] not in GOOD:
        # It is cancelled as soon as the base drives; one that a server only takes and ends is not a drive.
        before = "any action" if began is None else "the base drove"
        return [f"the next goal ended {ended['outcome']} before {before}: {ended['reason'][:160]}"]
    if began is not None:
        if began.at <= deadline:
            return []
        return [f"the next goal's first action began only after {began.at - ready.at:.1f} s"]
    until = cancelled.at if cancelled is not None else evidence.end
    if until <= deadline:
        return []
    return [f"the next goal has not begun {until - ready.at:.1f} s after it could"]


RULES: Tuple[Callable[[Evidence], List[str]], ...] = (
    base_stands,
    no_motion_after_the_end,
    the_end_is_reported,
    the_end_is_true,
    each_ends_for_itself,
    what_has_succeeded_holds,
    one_true_place,
    nothing_is_lost,
    what_is_full_is_said,
    no_process_is_left,
    every_node_is_back,
    every_node_answers,
    the_stop_is_answered,
    what_the_page_says_is_true,
    the_next_goal_works,
)


def _hangs(evidence: Evidence) -> List[str]:
    """A request that was not cancelled and has not ended has to do something."""
    sent = evidence.first(events.SENT, REQUEST)
    if sent is None or CLIENT in evidence.trial.fault.targets:
        return []
    asked, ended = evidence.first(events.CANCEL, REQUEST), evidence.first(events.ENDED, REQUEST)
    until = min(event.at for event in (asked, ended) if event is not None) if asked or ended else evidence.end
    if evidence.trial.fault.kind == AGAIN:
        return _reported_late(evidence, until)
    over = evidence.first(events.OVER)
    begin = max(evidence.zero, over.at if over is not None and over.at < until else evidence.zero)
    if until < evidence.deadline(begin, ANSWER_LIMIT - 0.5):
        return []
    window = until - SILENT
    works = [
        event
        for event in evidence.log
        if window <= event.at <= until
        and (
            (event.kind == events.DISPATCH and event["name"] != CANCEL_ACTION)
            or event.kind in (events.FEEDBACK, events.STATUS, events.GOALS)
        )
    ]
    moving = any(not stands(event) for event in evidence.all(events.TRUTH, window, until))
    if works or moving or scene_at(evidence.log, until).busy():
        return []
    span = f"{evidence.when(window)} to {evidence.when(until)}"
    return [f"the request neither ends nor goes on: nothing runs from {span}"]


def _reported_late(evidence: Evidence, until: float) -> List[str]:
    """What dies again and again has one limit, not a new one each time; an action that runs is progress."""
    waited = _without_action(evidence, until)
    if waited <= evidence.deadline(evidence.zero, RETURN_LIMIT) - evidence.zero:
        return []
    return [
        f"the request has not ended {until - evidence.zero:.1f} s after the first kill; no action ran for "
        f"{waited:.1f} s of that"
    ]


def _without_action(evidence: Evidence, until: float) -> float:
    """s from the fault until a time in which no server had a goal."""
    changes = [event.at for event in evidence.all(events.GOALS, evidence.zero, until)]
    times = [evidence.zero, *changes, until]
    return sum(end - at for at, end in zip(times, times[1:]) if not scene_at(evidence.log, at).busy())


def _outlives_its_client(evidence: Evidence) -> List[str]:
    """A request whose client has died is cancelled: that is what the client's library asks for."""
    trial = evidence.trial
    if CLIENT not in trial.fault.targets or trial.fault.lasts is not None:
        return []
    before = evidence.all(events.STATUS, -math.inf, evidence.zero)
    if before and before[-1]["state"] == IDLE:
        return []  # it had ended by itself just before
    idle = [
        event for event in evidence.all(events.STATUS, evidence.zero, evidence.end) if event["state"] == IDLE
    ]
    if not idle:
        return [f"the request of a dead client still runs at {evidence.when(evidence.end)}"]
    if idle[0].at <= evidence.deadline(evidence.zero, ANSWER_LIMIT):
        return []
    return [f"the request of a dead client runs for {idle[0].at - evidence.zero:.1f} s"]


def _cancelled_truly(evidence: Evidence, ended: Event) -> List[str]:
    found = []
    at, others = evidence.when(ended.at), used_by_others(evidence, ended)
    scene = scene_at(evidence.log, evidence.deadline(ended.at, END_GRACE))
    braked = world_time(evidence, ended.at) + BRAKING
    later = evidence.all(events.TRUTH, ended.at, evidence.end)
    after = next((event for event in later if event.get("ros", event.at) > braked), None)
    if after is not None and not stands(after) and "move_base" not in others:
        found.append(f"CANCELLED is reported at {at}, and the base moves with {scene.speed:.2f} m/s")
    servers = {"move_base": "navigation", "sound_play": "soundplay_node", "listen": "listen"}
    over = _over(evidence, ended.at)
    busy = [server for server in scene.busy() if servers[server] not in over and server not in others]
    if busy:
        found.append(f"CANCELLED is reported at {at}, and {', '.join(busy)} has not ended its goal")
    return found


def _over(evidence: Evidence, at: float) -> Set[str]:
    """The nodes that were killed, or have hung for so long that they were given up: their goals are over."""
    fault = evidence.trial.fault
    helped = evidence.first(events.HELPED)
    killed = fault.signal in ("KILL", "TERM") or (helped is not None and helped.at <= at)
    goes_on = evidence.zero + fault.lasts if fault.lasts is not None else evidence.end
    given_up = fault.signal == "STOP" and evidence.zero + GIVEN_UP < at <= goes_on
    return set(fault.targets) if killed or given_up else set()

# SPDX-License-Identifier: Apache-2.0
"""Trials: a fault at a moment of a request. Those of the known failures, and those drawn from a seed."""

import fnmatch
import functools
import random
from dataclasses import dataclass, field, replace
from typing import Dict, Iterator, List, Optional, Sequence, Set, Tuple

from chaos.faults import (
    AGAIN,
    CLIENT,
    DISK_FULL,
    FORGED_PAUSE,
    HALF_OPEN,
    LINK,
    MASTER,
    NODES,
    NONE,
    ONE_PAGE,
    PAGE_STOP,
    PLAIN_GOAL,
    PLAIN_SERVER,
    PLAIN_SET_TIME,
    ROBOT_TIME,
    SET_TIME,
    SIGNAL,
    START,
    TWO_ROBOTS,
    Fault,
    all_faults,
)
from chaos.moments import WINDOWS, Moment

DRIVE, SPEAK, LISTEN, SPEAK_AND_LISTEN = "drive", "speak", "listen", "speak_and_listen"
#: s that a planner of the campaign's own gets to misbehave.
PLANNER_TIME = 3.0
#: What the client asks for, so that the moment comes.
REQUESTS: Dict[Moment, Optional[str]] = {
    Moment.DRIVING: DRIVE,
    Moment.SPEAKING: SPEAK,
    Moment.LISTENING: LISTEN,
    Moment.PLANNING: DRIVE,
    Moment.BETWEEN: SPEAK_AND_LISTEN,
    Moment.IDLE: None,
    Moment.CANCELLING: DRIVE,
}


@dataclass(frozen=True)
class Variant:
    """How the system is started. Trials of one variant share a running system while it is healthy.

    :param base_timeout: s after which the base stops without commands; None: a base that never does.
    :param network: robot and the rest in network namespaces of their own.
    :param state_file: the knowledge base keeps its state in a file; "full": on a small file system.
    :param planner: name of a planner of the campaign's own; empty: the default one.
    :param navigation: name of a navigation of the campaign's own; empty: the default one.
    :param shuffled: nodes start at times drawn from the seed.
    :param time: "simulated"; "wall": as on a robot; "set": the same, and the clock on the wall can be set.
    :param page: with the monitor's page, and an operator.
    :param mission: with a mission that drives for ever.
    :param robots: names of several robots; empty: one without a name.
    """

    base_timeout: Optional[float] = None
    network: bool = False
    state_file: str = ""
    planner: str = ""
    navigation: str = ""
    shuffled: bool = False
    time: str = "simulated"
    page: bool = False
    mission: bool = False
    robots: Tuple[str, ...] = ()


#: What faults need that name a system of their own.
SYSTEMS: Dict[str, Variant] = {
    PLAIN_SERVER: Variant(navigation="plain_navigation"),
    ROBOT_TIME: Variant(time="wall"),
    SET_TIME: Variant(time="set"),
    PLAIN_SET_TIME: Variant(time="set", navigation="plain_navigation"),
    ONE_PAGE: Variant(page=True),
    TWO_ROBOTS: Variant(page=True, robots=("ann", "bob")),
}
#: Kinds of faults that say something only while the base drives.
ABOUT_DRIVES = (FORGED_PAUSE, HALF_OPEN, PAGE_STOP, PLAIN_GOAL)
#: Goals of the trials of a kind, in the place of those of the moment.
GOALS: Dict[str, Tuple[str, ...]] = {PLAIN_GOAL: ("(plain_at {place})",)}
#: Kinds whose requests the client does not cancel: the base stands, and the client is told, without that.
NOT_CANCELLED = (AGAIN, HALF_OPEN, PAGE_STOP)
#: One in so many drawn trials has a stop.
STOPS = 10
#: One in so many of the drawn trials that can has three requests in one plan.
JOINS = 4


@dataclass(frozen=True)
class Trial:
    """One trial.

    :param name: of the fault, or of the known failure.
    :param cancel: the client cancels right after the fault.
    :param alone: nodes that die do not come back by themselves.
    :param goals: that the client sends instead of those of the moment.
    :param seed: of the delay within the moment, and of the place to drive to.
    :param wait: s by which the fault comes later still, so that what misbehaves has begun to.
    :param stop: before the next goal the base is stopped by `merlin/stop`, and released.
    :param joined: two further requests, one with a deadline, join the one that drives.
    """

    name: str
    fault: Fault
    moment: Moment
    cancel: bool = False
    goals: Tuple[str, ...] = ()
    variant: Variant = field(default_factory=Variant)
    seed: int = 0
    wait: float = 0.0
    alone: bool = False
    stop: bool = False
    joined: bool = False

    @property
    def delay(self) -> float:
        """s between the begin of the moment and the fault."""
        return self.wait + random.Random(f"delay {self.seed}").uniform(0.0, WINDOWS[self.moment].delay)

    @property
    def label(self) -> str:
        """One line that names it."""
        parts = [self.name, f"@{self.moment.value}"]
        if self.cancel:
            parts.append("+cancel")
        if self.alone:
            parts.append("alone")
        if self.stop:
            parts.append("stop")
        if self.joined:
            parts.append("joined")
        return " ".join(parts)


def _known() -> Iterator[Trial]:
    faults = all_faults()
    driving = Moment.DRIVING

    def known(name: str, fault: str, moment: Moment = driving, cancel: bool = False, **more: object) -> Trial:
        return Trial(name, faults[fault], moment, cancel, **more)  # type: ignore[arg-type]

    nothing = Fault("none", NONE)
    # Nothing breaks: what the witness finds here it would find everywhere.
    yield Trial("nothing", nothing, driving)
    yield Trial("nothing_cancel", nothing, driving, cancel=True)
    yield known("fsm_host_killed_cancel", "merlin_fsm_host:kill", cancel=True)
    yield known("bridges_killed", "merlin_bridges:kill")
    yield known("bridges_and_host_killed", "merlin_bridges+merlin_fsm_host:kill")
    yield known("executor_killed", "merlin_executor:kill")
    yield known("planning_system_killed", "planning_system:kill")
    everything = Fault("robot:kill", SIGNAL, NODES, "KILL")
    yield Trial("power_cut_with_state_file", everything, driving, variant=Variant(state_file="kept"))
    yield known("navigation_killed", "navigation:kill")
    yield known("speech_killed", "soundplay_node:kill", Moment.SPEAKING)
    for part in ("merlin_fsm_host", "merlin_bridges", "navigation", "merlin_executor", "planning_system"):
        short = part.replace("merlin_", "")
        yield known(f"{short}_hung_cancel", f"{part}:stop", cancel=True)
    yield known("master_hung_cancel", "master:stop", cancel=True)
    cut = Variant(network=True)
    for lasts in (5.0, 12.0, 30.0):
        fault = Fault(f"link:cut{lasts:g}", LINK, lasts=lasts, loss=1.0)
        yield Trial(f"link_cut_{lasts:g}_cancel", fault, driving, cancel=True, variant=cut)
    yield known("link_cut_for_ever_cancel", "link:cut", cancel=True, variant=cut)
    yield known("master_killed_action_ends", "master:kill", Moment.SPEAKING)
    yield Trial(
        "move_base_ignores_cancel",
        nothing,
        driving,
        cancel=True,
        variant=Variant(navigation="deaf_navigation"),
    )
    yield Trial("action_ignores_preempt", nothing, driving, cancel=True, goals=("(deaf_at {place})",))
    yield Trial("action_raises_in_preempt", nothing, driving, cancel=True, goals=("(touchy_at {place})",))
    yield Trial("action_raises_system_exit", nothing, Moment.PLANNING, goals=("(quitted {note})",))
    nested = "(and " * 1000 + "(said {note})" + ")" * 1000
    yield Trial("goal_of_1000_nested_and", nothing, Moment.IDLE, goals=(nested,))
    yield known("second_executor", "second:merlin_executor")
    for planner in ("planner_without_end", "planner_100_mb", "planner_with_daemon"):
        variant = Variant(planner=planner)
        # What one without end costs shows at its time limit, what the others cost at a cancel.
        cancel = planner != "planner_without_end"
        yield Trial(planner, nothing, Moment.PLANNING, cancel, variant=variant, wait=PLANNER_TIME)


@functools.lru_cache(maxsize=None)
def known_failures() -> Dict[str, Trial]:
    """The failures that were found by hand, as trials, by name."""
    return {trial.name: trial for trial in _known()}


def variant_of(fault: Fault) -> Variant:
    """The system that a fault needs."""
    if fault.kind == LINK:
        return Variant(network=True)
    if fault.kind == DISK_FULL:
        return Variant(state_file="full")
    if fault.kind == START:
        return Variant(shuffled=True)
    if fault.system:
        return SYSTEMS[fault.system]
    # Only the guard stops a base that never stops by itself: without a guard nothing does.
    return Variant(base_timeout=0.5 if fault.touches_guard else None)


def fits(fault: Fault, moment: Moment, respawn: bool) -> bool:
    """Whether a fault makes sense at a moment."""
    if fault.kind == START and moment is not Moment.IDLE:
        return False
    about_drives = fault.kind in ABOUT_DRIVES or fault.system in (PLAIN_SERVER, PLAIN_SET_TIME)
    if about_drives and moment is not Moment.DRIVING:
        return False
    if fault.kind != SIGNAL or fault.system:
        return respawn
    if not respawn and (MASTER in fault.targets or CLIENT in fault.targets):
        return False  # neither comes back by itself in any case
    if CLIENT in fault.targets:
        return moment is not Moment.IDLE
    return True


def can_join(trial: Trial) -> bool:
    """Whether the robot of a trial drives, and can speak meanwhile for others."""
    known = trial.name in known_failures()
    about_drives = trial.goals or trial.fault.kind in ABOUT_DRIVES
    variant = trial.variant
    other = variant.robots or variant.planner or variant.navigation or variant.state_file == "full"
    return REQUESTS[trial.moment] == DRIVE and not (known or about_drives or other)


def draw(
    seed: int,
    faults: Sequence[str] = ("*",),
    moments: Sequence[Moment] = tuple(Moment),
    respawn: Sequence[bool] = (True, False),
    absent: Sequence[str] = (),
    joins: int = JOINS,
) -> Iterator[Trial]:
    """Trials without end, drawn from a seed: every combination once, in random order, then again.

    :param faults: patterns of names; a known failure is drawn when it is named, `known` stands for all.
    :param absent: nodes that the system does not have.
    :param joins: one in so many of those that can has three requests in one plan.
    :raises ValueError: when nothing fits the patterns.
    """
    pool = _pool(faults, moments, respawn, set(absent))
    if not pool:
        raise ValueError(f"no fault fits {', '.join(faults)} at these moments; --list shows all")
    numbers = random.Random(f"trials {seed}")
    number = able = 0
    while True:
        order = list(pool)
        numbers.shuffle(order)
        for trial in order:
            cancel = trial.cancel
            named = trial.name in known_failures()
            if not named and trial.moment not in (Moment.IDLE, Moment.CANCELLING):
                cancel = numbers.random() < 0.5 and CLIENT not in trial.fault.targets
                cancel = cancel and trial.fault.kind not in NOT_CANCELLED
            number += 1
            stop = trial.fault.takes_what_nodes_need or (number % STOPS == 0 and not named)
            joins_one = can_join(trial)
            able += joins_one
            joined = joins_one and able % joins == 0
            yield replace(trial, cancel=cancel, seed=numbers.randrange(2**31), stop=stop, joined=joined)


def _pool(
    patterns: Sequence[str], moments: Sequence[Moment], respawn: Sequence[bool], absent: Set[str]
) -> List[Trial]:
    named = known_failures()
    chosen = [
        trial
        for name, trial in named.items()
        if "known" in patterns
        or any(fnmatch.fnmatchcase(name, pattern) for pattern in patterns if pattern != "*")
    ]
    for fault in all_faults().values():
        matches = any(fnmatch.fnmatchcase(fault.name, each) for each in patterns)
        if absent & {*fault.targets, fault.on} or not matches:
            continue
        chosen += [
            Trial(
                fault.name,
                fault,
                moment,
                goals=GOALS.get(fault.kind, ()),
                variant=variant_of(fault),
                alone=not again,
            )
            for moment in moments
            for again in respawn
            if fits(fault, moment, again)
        ]
    return chosen

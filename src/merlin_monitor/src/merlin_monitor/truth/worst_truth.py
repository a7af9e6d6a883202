# SPDX-License-Identifier: Apache-2.0
"""The one rule of the headline: of what was said last, who still lives and what holds the base, the worst."""

import statistics
from typing import Any, Dict, List, Mapping, NamedTuple, Tuple

from merlin_monitor.text.phrase import Phrase, say

EXECUTOR, PLANNING, NAVIGATION = "executor", "planning", "navigation"
SIMULATOR, GUARD, MISSION = "simulator", "guard", "mission"
BRIDGES, MACHINES = "bridges", "machines"
#: Owners of what is said → how they are called. The first one that is lost is in the headline.
OWNERS: Mapping[str, Phrase] = {
    EXECUTOR: say("the Executor"),
    SIMULATOR: say("the simulator"),
    PLANNING: say("the planning system"),
    BRIDGES: say("the process of the bridges"),
    MACHINES: say("the process of the state machines"),
    GUARD: say("the velocity guard"),
    NAVIGATION: say("the navigation server"),
}
LIVE = ("starting", "running", "paused")
GOOD, WARN, BAD = "good", "warn", "bad"
_NOT_KNOWN = (say("Not known"), BAD, False, False)  # state, tone, known, expected
_ENDED = {
    "succeeded": (say("Finished"), GOOD),
    "failed": (say("Failed"), BAD),
    "cancelled": (say("Cancelled"), WARN),
}


class Facts(NamedTuple):
    """What is known of a robot.

    :ivar doing, because, step: what it does, why, and which step of the plan that is, as it was said last.
    :ivar task: of the mission, as it was said last.
    :ivar executor, mission: their last words, as the state has them; empty: not heard yet.
    :ivar waits: whether an operator has to let something go on.
    :ivar acts: whether an action is under way.
    :ivar drives: whether a drive is under way.
    :ivar lost: owner → what is wrong with it, of those that were there.
    :ivar stopped: while all bases are stopped by hand: by whom; else empty.
    :ivar kept: while the guard keeps the base from a drive: why; else empty.
    """

    doing: Phrase
    because: Phrase = ""
    step: Phrase = ""
    task: Phrase = ""
    executor: Mapping[str, Any] = {}
    mission: Mapping[str, Any] = {}
    waits: bool = False
    acts: bool = False
    drives: bool = False
    lost: Mapping[str, str] = {}
    stopped: Phrase = ""
    kept: Phrase = ""


class Truth(NamedTuple):
    """What is shown.

    :ivar doing, because, step: the headline and what is below it.
    :ivar state: in a word.
    :ivar tone: of that word: good, warn, bad, or empty.
    :ivar known: whether progress is still known.
    :ivar expected: whether it goes on as planned, so that what comes next, and when, can be expected.
    :ivar blamed: the lost owner that the headline names; empty: none.
    """

    doing: Phrase
    because: Phrase
    step: Phrase
    state: Phrase
    tone: str
    known: bool
    expected: bool
    blamed: str = ""


def worst_truth(facts: Facts) -> Truth:
    """The worst of what is true."""
    truth = Truth(facts.doing, facts.because, facts.step, *_state(facts), True, False)
    active = facts.acts or facts.executor.get("state", "idle") != "idle"
    lost = _lost(facts, active)
    if lost:
        before = say("before: {what}", what=facts.doing)
        truth = Truth(_not_known(OWNERS[lost], facts.lost[lost]), before, "", *_NOT_KNOWN, lost)
    else:
        truth = _without_what_comes(facts, truth, active)
    if facts.stopped:
        # What the Executor does comes second: nothing of it moves the base.
        because = say("the Executor: {what}", what=truth.doing)
        return truth._replace(
            doing=facts.stopped, because=because, step="", state=say("Stopped and held"), tone=BAD
        )
    if lost or facts.executor.get("state") == "cancelling":
        return truth
    if facts.kept and facts.drives:
        kept = say("the base is held: {why}", why=facts.kept)
        because = say("the Executor: {what}", what=truth.doing)
        return truth._replace(doing=kept, because=because, state=say("Base held"), tone=BAD)
    goes_on = active and not facts.waits and not facts.executor.get("paused")
    return truth._replace(expected=goes_on and truth.known and not facts.executor.get("waits"))


def lost_words(owner: str, mission: Phrase, lost: Mapping[str, Any]) -> Phrase:
    """What is wrong with an owner, with its node.

    :param mission: its name.
    :param lost: node and what is wrong, as the state has them.
    """
    node = str(lost["node"]).strip("/") or say("a node")
    who = OWNERS.get(owner, mission)
    return say("{who} ({node}) {what}", who=who, node=node, what=say(lost["what"]))


def _lost(facts: Facts, active: bool) -> str:
    """The first owner that is lost, of those on whom what is said depends; empty: none."""
    for owner in OWNERS:
        needed = {
            PLANNING: active,
            BRIDGES: facts.acts,
            MACHINES: facts.acts,
            NAVIGATION: active and facts.drives,
            GUARD: active and facts.drives,
        }.get(owner, True)
        if needed and owner in facts.lost:
            return owner
    return ""


def _not_known(who: Phrase, wrong: str) -> Phrase:
    return say("not known: {who} {what}", who=who, what=say(wrong))


def _without_what_comes(facts: Facts, truth: Truth, active: bool) -> Truth:
    """What is done goes on; where an owner of what comes next is lost, that is said, too."""
    goes_on = facts.mission.get("state") in LIVE
    needed = [(MISSION, goes_on and not active), (PLANNING, goes_on), (MISSION, goes_on)]
    needed[2:2] = [(owner, active) for owner in (BRIDGES, MACHINES, GUARD, NAVIGATION)]
    lost = next((owner for owner, needs in needed if needs and owner in facts.lost), "")
    if not lost:
        return truth
    who, wrong = OWNERS.get(lost) or facts.mission["name"], facts.lost[lost]
    if lost == MISSION and not active:
        before = say("before: {what}", what=facts.task or say(facts.mission["state"]))
        return Truth(_not_known(who, wrong), before, "", *_NOT_KNOWN, MISSION)
    doing = say("{what}; but {who} {wrong}", what=facts.doing, who=who, wrong=say(wrong))
    return truth._replace(doing=doing, tone=BAD, known=False, blamed=lost)


def _state(facts: Facts) -> Tuple[Phrase, str]:
    """The word for what was said last, and its tone."""
    executor, mission = facts.executor, facts.mission
    if executor.get("state") == "cancelling":
        return say("Stopping"), WARN
    if facts.waits:
        return say("Held"), WARN
    if executor.get("state") == "running" or facts.acts:
        if executor.get("paused"):
            return say("Pausing"), WARN
        return say("Working") if facts.acts else say("Preparing"), GOOD
    if executor.get("paused") or mission.get("state") == "paused":
        return say("Paused"), WARN
    if mission.get("state") in _ENDED:
        return _ENDED[mission["state"]]
    return say("Idle") if executor or mission else say("Nothing heard yet"), ""


MOST_TASKS = 20  # tasks that count, the last ones


class TaskPace:
    """Notes when the tasks of one mission begin. The median of those that ended is expected of the others:
    a pause or a stop makes one of them long.
    """

    def __init__(self) -> None:
        self._task = 0
        self._since = 0.0  # s of ROS time
        self._whole = False  # whether the beginning of the task was seen
        self._lasted: List[float] = []  # s

    def take_up(self, kept: Mapping[str, Any]) -> None:
        """Goes on where an earlier life of the monitor ended, by the mission as it was shown."""
        if kept.get("pace"):
            self._task, self._since, self._whole = kept["task"], kept["since"], True
            self._lasted = [kept["pace"]]

    def task(self, number: int, at: float) -> None:
        """Takes the number of the present task, from 1, and when that was heard, s of ROS time."""
        if number == self._task:
            return
        if at < self._since:
            self._lasted = []  # simulated time was set back
        elif number == self._task + 1 and self._whole:
            self._lasted = [*self._lasted, at - self._since][-MOST_TASKS:]
        elif number < self._task:
            self._lasted = []  # the mission began anew
        self._whole = number == 1 or number == self._task + 1
        self._task, self._since = number, at

    def shown(self) -> Dict[str, float]:
        """When the present task began, and how long one takes, s; empty: not known."""
        return {"since": self._since, "pace": statistics.median(self._lasted)} if self._lasted else {}

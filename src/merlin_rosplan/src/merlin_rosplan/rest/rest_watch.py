# SPDX-License-Identifier: Apache-2.0
"""Judges the rest of one plan at each change that its own actions do not make."""

import logging
import math
from collections import deque
from typing import AbstractSet, Deque, Dict, FrozenSet, List, Mapping, NamedTuple, Optional, Set, Tuple

from merlin_pddl.plan_text import OUTDATED
from merlin_rosplan.dispatch.dispatch_environment import (
    DispatchEnvironment,
    DispatchError,
    KnowledgeChanged,
    PlanGoals,
    RestVerdict,
    RestWatch,
)
from merlin_rosplan.dispatch.dispatch_graph import GraphSchedule
from merlin_rosplan.dispatch.dispatch_schedule import PlannedAction
from merlin_rosplan.dispatch.operator_model import Conditions, PlanTerm
from merlin_rosplan.rest.plan_rest import Need, Needs, PlanRest, literal_of

_log = logging.getLogger(__name__)
GOAL_HOLDS = "the goal holds already: the rest of the plan is not needed"
_LATE = 8  # actions that ended last, whose effects may be heard of after their end
_LOOKS = 5  # so often at most the world is read again because an action began or ended meanwhile
_TRIALS = 50  # sets of steps to leave out that are tried at most, for one change
_NO_GOALS = PlanGoals(Conditions())

_Fact = Tuple[PlanTerm, bool]


class _Look(NamedTuple):
    """The world at one moment, and what has changed in it."""

    running: Mapping[int, bool]
    held: FrozenSet[PlanTerm]
    """Facts that are as they are only while an action runs."""
    goals: PlanGoals
    names: Optional[FrozenSet[str]]
    known: Dict[Conditions, bool]
    """Conditions that were asked."""


class PlanWatch(RestWatch):
    """Watches one dispatch, over a knowledge base that lists its executions; over another it does nothing.

    The effects of actions that run count as coming, and what holds only while they run does not count. A
    timed change that is still to come may make true what is missing.

    :param schedule: of the plan.
    :param environment: gives operators and answers.
    :param missed: names that changed since the dispatch before, or since the plan was made; None: any may
        have. Whether the plan leads to the goals is not judged by these.
    """

    def __init__(
        self,
        schedule: GraphSchedule,
        environment: DispatchEnvironment,
        missed: Optional[FrozenSet[str]] = frozenset(),
    ) -> None:
        self._schedule = schedule
        self._environment = environment
        self._order = schedule.happenings()
        self._made: Optional[PlanRest] = None
        self._off = not schedule.actions
        self._ended: Set[int] = set()
        self._running: Set[int] = set()
        self._skipped: FrozenSet[int] = frozenset()
        self._coming: Dict[int, Optional[Set[_Fact]]] = {}  # effects of started actions that were not seen
        self._late: Deque[int] = deque()  # of those, the actions that have ended
        self._watched: FrozenSet[str] = frozenset()  # names that conditions and goals depend on, and objects
        self._missed = missed
        self._names: Optional[FrozenSet[str]] = missed  # changed since the last look; None: any
        self._facts: Set[_Fact] = set()  # changed since the last look
        self._meanwhile: Set[str] = set()  # changed while actions run: looked at once more when one ends
        self._timed: Set[str] = set()  # names that a timed change is to make right

    @property
    def skipped(self) -> AbstractSet[int]:
        """Actions that are not needed any more."""
        return self._skipped

    def started(self, action_id: int) -> None:
        """An action was sent; its effects are expected from now on."""
        self._running.add(action_id)
        self._coming[action_id] = None

    def ended(self, action_id: int) -> None:
        """An action has ended: what changed while it ran is judged without it."""
        self._ended.add(action_id)
        self._running.discard(action_id)
        self._late.append(action_id)
        if len(self._late) > _LATE:
            self._coming.pop(self._late.popleft(), None)
        if self._meanwhile:
            self._add(frozenset(self._meanwhile))
            self._meanwhile.clear()

    def changed(self, change: KnowledgeChanged) -> None:
        """Notes what the plan's own actions have not changed as they should."""
        if self._off:
            return
        if change.names is None:
            self._names = None
            return
        if not change.names and not self._timed:
            return
        facts = {(PlanTerm(key[0], key[1:]), holds) for key, holds in change.facts}
        rest = self._rest()
        if rest is None:
            self._names = None
            self._facts |= facts
            return
        news = {fact for fact in facts if not self._own(rest, fact)}
        others = change.names - {term.name for term, _ in facts}
        names = (others | {term.name for term, _ in news}) & self._watched
        names |= self._timed  # a timed change may have been taken back
        self._facts |= news
        if self._running:
            self._meanwhile |= names
        self._add(frozenset(names))

    def look(self) -> Optional[RestVerdict]:
        """Judges what has changed since the last look."""
        if self._off or (self._names is not None and not self._names):
            return None
        rest = self._rest()
        if rest is None:
            return None
        names, facts = self._names, self._facts
        self._names, self._facts = frozenset(), set()
        if names is not None and self._missed:
            names &= self._watched
        missed, self._missed = self._missed, frozenset()
        known = missed == frozenset()
        self._timed.clear()
        try:
            for _ in range(_LOOKS):
                held = self._environment.held()
                if held is None:
                    self._off = True
                    _log.debug("the rest of plans is not watched: the knowledge base lists no executions")
                    return None
                goals = (self._environment.goals() if known else None) or _NO_GOALS
                verdict = self._judge(rest, names, facts, held, goals)
                if verdict is None or self._environment.held() == held:
                    return verdict
        except DispatchError as error:
            _log.debug("the rest of the plan is not judged: %s", error)
        self._add(names)  # with the next event, as they were
        self._facts |= facts
        self._missed = missed
        return None

    # --- what has changed ---------------------------------------------------------------------------

    def _add(self, names: Optional[FrozenSet[str]]) -> None:
        self._names = None if names is None or self._names is None else self._names | names

    def _own(self, rest: PlanRest, fact: _Fact) -> bool:
        """Whether a change is the effect of an action that was started; once for each."""
        for action_id, coming in self._coming.items():
            if coming is None:
                coming = self._coming[action_id] = rest.effects(action_id)
            if fact in coming:
                coming.discard(fact)
                return True
        return False

    def _rest(self) -> Optional[PlanRest]:
        if self._made is None and not self._off:
            try:
                models = {
                    each.id: self._environment.operator(each) for each in self._schedule.actions.values()
                }
                goals = self._environment.goals() or _NO_GOALS
            except DispatchError as error:  # it is reported when the action is reached
                _log.debug("the rest of the plan is not watched yet: %s", error)
                return None
            self._made = PlanRest(self._order, models)
            self._watched = self._made.reads | goals.literals.names | goals.reads | {""}
        return self._made

    # --- the verdict ----------------------------------------------------------------------------------

    def _judge(
        self,
        rest: PlanRest,
        names: Optional[FrozenSet[str]],
        facts: Set[_Fact],
        held: Mapping[int, FrozenSet[PlanTerm]],
        goals: PlanGoals,
    ) -> Optional[RestVerdict]:
        running = {action_id: action_id in held for action_id in self._running}
        meanwhile: FrozenSet[PlanTerm] = frozenset().union(*held.values())
        look = _Look(running, meanwhile, goals, names, {})
        over = self._ended | self._skipped
        needed = any(rest.constrained(each) for each in self._schedule.actions if each not in over)
        if not needed and self._came_true(look, facts) and self._environment.goals_hold():
            return RestVerdict(GOAL_HOLDS, achieved=True)
        gone = self._gone_object(rest, names)
        if gone is not None:
            return gone
        needs, false = self._false(rest, look, self._skipped, changed_only=True)
        if false and self._skipped:
            self._skipped = frozenset()  # what made them unnecessary is no longer so
            needs, false = self._false(rest, look, self._skipped)
        self._skipped, left = self._leave_out(rest, look, facts, needs, false)
        return self._verdict(left[0]) if left else None

    def _came_true(self, look: _Look, facts: Set[_Fact]) -> bool:
        """Whether a goal is among what has changed, and is not so only while an action runs."""
        goals = {(atom.key, True) for atom in look.goals.literals.positive}
        goals |= {(atom.key, False) for atom in look.goals.literals.negative}
        if look.held & {term for term, _ in goals}:
            return False
        return bool(goals & facts) or bool(look.goals.reads & (look.names or frozenset()))

    def _gone_object(self, rest: PlanRest, names: Optional[FrozenSet[str]]) -> Optional[RestVerdict]:
        """The verdict on a step whose object was removed."""
        objects = self._environment.objects() if names is None or "" in names else None
        for action_id in [] if objects is None else self._waiting():
            for name in rest.arguments(action_id):
                if objects is not None and name.lower() not in objects:
                    action = self._schedule.actions[action_id]
                    what = f"{self._step(action)} cannot be carried out: there is no object {name}"
                    return RestVerdict(f"{OUTDATED}{what}", False, action)
        return None

    def _waiting(self) -> List[int]:
        """Ids of the actions that have not started and are not skipped, in the order of the plan."""
        over = self._ended | self._running | self._skipped
        return [action_id for action_id, at_end in self._order if not at_end and action_id not in over]

    def _false(
        self, rest: PlanRest, look: _Look, left_out: AbstractSet[int], changed_only: bool = False
    ) -> Tuple[Needs, List[Need]]:
        """What the rest needs without some steps, and what of it does not hold.

        :param changed_only: ask only what has changed; the rest held when the plan was made.
        """
        needs = rest.needs(look.running, self._ended | left_out, look.goals.literals)
        asked: List[Need] = []
        for need in needs.of_now:
            literal = literal_of(need.condition)
            if need.condition in look.known or (literal is not None and literal[0] in look.held):
                continue
            if changed_only and look.names is not None and not need.names & look.names:
                look.known[need.condition] = True
            else:
                asked.append(need)
        unmet = self._ask(asked)
        for need in asked:
            look.known[need.condition] = need not in unmet
        return needs, [need for need in needs.of_now if not look.known.get(need.condition, True)]

    def _ask(self, needs: List[Need]) -> List[Need]:
        """Those that do not hold, and that no timed change may make true."""
        actions = self._schedule.actions
        unmet = []
        some = next(iter(actions.values()))
        asked = [(actions.get(need.step, some), need.condition) for need in needs]
        for need, (action, _), false in zip(
            needs, asked, self._environment.false_of_each(asked) if asked else []
        ):
            if false.empty or self._environment.robot_left(action, false):  # the others go on without it
                continue
            if self._environment.next_change(need.names, math.inf) is not None:
                self._timed |= need.names
            else:
                unmet.append(need)
        return unmet

    def _leave_out(
        self, rest: PlanRest, look: _Look, facts: Set[_Fact], needs: Needs, false: List[Need]
    ) -> Tuple[FrozenSet[int], List[Need]]:
        """Which steps are not needed, and what is missing all the same.

        A step may go whose effect came true by itself, or that cannot start; then those that only served it.
        Without goals it is not known what a step is for.
        """
        if look.goals == _NO_GOALS:
            return self._skipped, false
        first = [
            action_id
            for action_id in self._waiting()
            if facts & rest.effects(action_id) or any(need.step == action_id for need in false)
        ]
        left_out, missing = self._skipped, [*needs.broken, *false]
        candidates, tried = first[::-1], set(self._skipped)
        while candidates and len(tried) < _TRIALS:
            action_id = candidates.pop(0)
            if rest.constrained(action_id):
                continue
            if action_id in tried or rest.changes(action_id) & (needs.unjudged | look.goals.reads):
                continue
            tried.add(action_id)
            trial = left_out | {action_id}
            then, unmet = self._false(rest, look, trial)
            lacks = [*then.broken, *unmet]
            if any(need not in missing for need in lacks):
                continue
            left_out, missing, false = trial, lacks, unmet
            served = rest.needed_facts(action_id)
            candidates += [
                other
                for other in self._waiting()[::-1]
                if other not in left_out and served & rest.effects(other)
            ]
        if false:
            return self._skipped, false
        for action_id in sorted(left_out - self._skipped):
            _log.info("%s is skipped: it is not needed any more", self._schedule.actions[action_id])
        return left_out, []

    def _verdict(self, need: Need) -> RestVerdict:
        action = self._schedule.actions.get(need.step)
        when = "at its end " if need.at_end else ""
        what = "its goal is not reached" if action is None else f"{self._step(action)} cannot be carried out"
        return RestVerdict(f"{OUTDATED}{what}: {when}{need.condition.as_false()}", False, action)

    def _step(self, action: PlannedAction) -> str:
        number = [action_id for action_id, at_end in self._order if not at_end].index(action.id) + 1
        return f"step {number}, {action},"

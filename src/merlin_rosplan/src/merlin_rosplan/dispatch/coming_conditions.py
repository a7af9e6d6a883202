# SPDX-License-Identifier: Apache-2.0
"""Conditions that do not hold yet, and may come true by themselves: the action that needs them waits."""

from typing import Any, Collection, Dict, Iterable, Iterator, List, Mapping, Optional, Set, Union

from merlin_pddl.evaluation import arithmetic, compare
from merlin_pddl.formula import Arithmetic, Fluent, Number, Numeric
from merlin_rosplan.dispatch.dispatch_environment import DispatchEnvironment
from merlin_rosplan.dispatch.dispatch_running import Running
from merlin_rosplan.dispatch.dispatch_schedule import PlannedAction, Schedule
from merlin_rosplan.dispatch.operator_model import Conditions, Inequality, PlanTerm
from merlin_rosplan.dispatch.plan_graph import TimedLiteral, TimedValue


class TimedNumbers:
    """The timed values of a plan, and from when on a condition holds because of them.

    :param timed: literals count for expressions, of which only the names are known here.
    :param values: what function terms are worth before, by `PlanTerm.key`.
    :param epsilon: s by which times may be off.
    """

    def __init__(
        self,
        timed: Iterable[Union[TimedLiteral, TimedValue]],
        values: Mapping[PlanTerm, float],
        epsilon: float,
    ) -> None:
        self._entries = sorted(timed, key=lambda entry: entry.time)
        self._values = dict(values)
        self._epsilon = epsilon

    def __bool__(self) -> bool:
        return bool(self._entries)

    def since(self, conditions: Conditions, now: float, changed: Mapping[PlanTerm, float]) -> Optional[float]:
        """The time, s, that the conditions of a node have to wait for; None when there is none.

        :param now: planned time of the node, s.
        :param changed: when actions of the plan changed a term last; what it is worth then is not known.
        """
        found: List[float] = []
        for entry in conditions.comparisons:
            time = self._since(entry, now, changed)
            if time is not None:
                found.append(time)
        for expression in conditions.expressions:
            times = [e.time for e in self._past(now) if _name(e) in expression.reads]
            found.extend(times[-1:])
        return max(found, default=None)

    def _past(self, now: float) -> List[Union[TimedLiteral, TimedValue]]:
        return [entry for entry in self._entries if entry.time <= now + self._epsilon]

    def _since(self, entry: Inequality, now: float, changed: Mapping[PlanTerm, float]) -> Optional[float]:
        terms = {term.key for term in entry.reads}
        last_change = max((changed[term] for term in terms if term in changed), default=None)
        past = [
            timed for timed in self._past(now) if isinstance(timed, TimedValue) and timed.term.key in terms
        ]
        if not past:
            return None
        if last_change is not None:  # the values before it are not known
            return past[-1].time if past[-1].time > last_change else None
        values = {term: self._values[term] for term in terms if term in self._values}
        held = [comparison_holds(entry, values)]
        for timed in past:
            values[timed.term.key] = timed.value
            held.append(comparison_holds(entry, values))
        first = len(held) - 1
        while first > 0 and held[first - 1]:
            first -= 1
        return past[first - 1].time if first > 0 else None


def _name(entry: Union[TimedLiteral, TimedValue]) -> str:
    return (entry.atom if isinstance(entry, TimedLiteral) else entry.term).name.lower()


def comparison_holds(entry: Inequality, values: Mapping[PlanTerm, float]) -> bool:
    """Whether a ground comparison holds with these values of its terms; without one of them it does not."""
    left, right = _worth(entry.condition.left, values), _worth(entry.condition.right, values)
    return left is not None and right is not None and compare(entry.condition.op, left, right)


def _worth(expression: Numeric, values: Mapping[PlanTerm, float]) -> Optional[float]:
    """The worth of an expression; None when a term in it has no value."""
    if isinstance(expression, Number):
        return expression.value
    if isinstance(expression, Fluent):
        return values.get(PlanTerm(expression.name, expression.args).key)
    if isinstance(expression, Arithmetic):
        return arithmetic(expression.op, [_worth(part, values) for part in expression.parts])
    return None


class ComingConditions:
    """The actions of one dispatch whose conditions a timed change or start effects may make true.

    :param settle: s within which start effects and timed changes are applied.
    """

    def __init__(self, environment: DispatchEnvironment, schedule: Schedule, settle: float) -> None:
        self._environment = environment
        self._schedule = schedule
        self._settle = settle
        self._actions: Set[int] = set()  # that wait for effects, or for a timed change whose time has come
        self._timed: Dict[int, Any] = {}  # deadlines of the timed changes whose time has come
        self._due: Dict[int, float] = {}  # ROS time, s, at which a timed change comes

    @property
    def expected(self) -> bool:
        """Whether an action waits for effects, or for a timed change whose time has come."""
        return bool(self._actions)

    def may_come(
        self, action: PlannedAction, unmet: Conditions, began: float, running: Collection[Running]
    ) -> bool:
        """Whether the conditions that an action lacks may still come true.

        :param began: ROS time, s, of the begin of the dispatch.
        :param running: the actions whose effects may make them true.
        """
        due = self._environment.next_change(unmet.names, began + action.time + self._settle)
        if due is not None:
            self._due[action.id] = due
            return True
        timed = self._due.pop(action.id, None) is not None or self._schedule.waits_for_time(action.id)
        if timed and action.id not in self._timed:
            self._timed[action.id] = self._environment.deadline(self._settle)
        # ROSPlan's graph has a plain action's effects at its start; an interface may apply them at its end.
        if self._deadlines(action.id, running) or any(record.brings(unmet) for record in running):
            self._actions.add(action.id)
            return True
        self._actions.discard(action.id)
        return False

    def came(self, action_id: int) -> None:
        """The conditions of an action hold; it starts."""
        self._actions.discard(action_id)
        self._due.pop(action_id, None)

    def changes_after(self, now: float) -> List[float]:
        """ROS times, s, of the timed changes that come after `now`."""
        return [time for time in self._due.values() if time > now]

    def time_left(self, running: Collection[Running]) -> Iterator[float]:
        """Seconds until what an action waits for should have come."""
        for action_id in self._actions:
            yield from self._deadlines(action_id, running)

    def _deadlines(self, action_id: int, running: Collection[Running]) -> List[float]:
        deadlines = [record.settle for record in running]
        if action_id in self._timed:
            deadlines.append(self._timed[action_id])
        return [left for left in (deadline.remaining() for deadline in deadlines) if left > 0]

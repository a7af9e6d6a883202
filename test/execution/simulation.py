# SPDX-License-Identifier: Apache-2.0
"""A world for dispatches that keeps its own time: action interfaces and a knowledge base, in one thread.

It writes down when the effects of which action came true, for the judge.
"""

import heapq
import itertools
import queue
import random
from typing import Any, Callable, Dict, FrozenSet, List, NamedTuple, Optional, Sequence, Set, Tuple

from pddl21 import Ground, Model, State, Tree
from semantics import Event

from merlin_pddl.domain import Domain
from merlin_pddl.domain_reader import parse_domain
from merlin_pddl.evaluation import Evaluator, WorldState
from merlin_pddl.plan_text import PlanStep
from merlin_rosplan.dispatch.dispatch import PlanDispatch
from merlin_rosplan.dispatch.dispatch_environment import (
    DispatchEnvironment,
    DispatchLimits,
    DispatchReport,
    Feedback,
    FeedbackStatus,
    KnowledgeChanged,
    Tick,
)
from merlin_rosplan.dispatch.dispatch_graph import GraphSchedule, SequentialSchedule
from merlin_rosplan.dispatch.dispatch_schedule import PlannedAction
from merlin_rosplan.dispatch.operator_model import ActionModel, Conditions, PlanTerm
from merlin_rosplan.dispatch.plan_graph import TimedLiteral, TimedValue
from merlin_rosplan.dispatch.plan_graph_builder import build_graph
from merlin_rosplan.dispatch.timed_numbers import comparison_holds

PLAN_ID = 3
END_OF_TIME = 1e5  # s of simulated time


class Planned(NamedTuple):
    """A plan with everything that is known of its domain."""

    model: Model
    domain: Domain
    steps: List[PlanStep]
    actions: List[Ground]
    operators: List[ActionModel]

    @staticmethod
    def make(sections: str, model: Model, steps: Sequence[PlanStep]) -> "Planned":
        """:param sections: of the domain, with all declarations."""
        domain = parse_domain(f"(define (domain d) (:requirements :adl :durative-actions) {sections})")
        operators = []
        for step in steps:
            operator = ActionModel.of(domain.operators[step.name.lower()], domain.derived)
            operators.append(operator.ground(operator.bind(step.arguments, step.duration)))
        actions = [model.ground(step.name, step.arguments) for step in steps]
        return Planned(model, domain, list(steps), actions, operators)

    def schedule(self, kind: str) -> GraphSchedule:
        """What the parser of a kind makes of it, and the dispatcher of the same kind."""
        planned = [
            PlannedAction(
                index, step.name, tuple(("", each) for each in step.arguments), step.duration, step.time
            )
            for index, step in enumerate(self.steps)
        ]
        if kind == "simple":
            return SequentialSchedule(planned)
        values = {PlanTerm(key[0], key[1:]): value for key, value in self.model.initial.values.items()}
        graph = build_graph(self.steps, self.operators, self._timed(), values=values)
        return GraphSchedule(graph, planned)

    def _timed(self) -> List[Any]:
        found: List[Any] = []
        for time, effect in self.model.timed:
            if effect[0] == "=":
                found.append(TimedValue(time, PlanTerm(effect[1][0], tuple(effect[1][1:])), float(effect[2])))
            else:
                negative = effect[0] == "not"
                atom = effect[1] if negative else effect
                found.append(TimedLiteral(time, PlanTerm(atom[0], tuple(atom[1:])), negative))
        return found


class Outcome(NamedTuple):
    """How a dispatch went."""

    report: DispatchReport
    events: List[Event]
    state: State
    sent: List[Tuple[float, int]]


class Events:
    """The queue of a dispatch that waits in simulated time."""

    def __init__(self, world: "World") -> None:
        self._world = world
        self._there: List[Any] = []

    def put(self, event: Any) -> None:
        self._there.append(event)

    def get(self, timeout: Optional[float] = None) -> Any:
        end = END_OF_TIME if timeout is None else self._world.time + timeout
        while not self._there:
            if not self._world.step(end):
                if timeout is None:
                    raise AssertionError("the dispatch waits for ever")
                raise queue.Empty
        return self._there.pop(0)

    def get_nowait(self) -> Any:
        if not self._there:
            raise queue.Empty
        return self._there.pop(0)


class _Deadline:
    def __init__(self, world: "World", seconds: Optional[float]) -> None:
        self._world = world
        self._end = float("inf") if seconds is None else world.time + seconds

    def remaining(self) -> float:
        return max(0.0, self._end - self._world.time)


class _Stored(WorldState):
    """The facts as the planning system's own evaluator asks for them."""

    def __init__(self, model: Model, state: State) -> None:
        self._model, self._state = model, state

    def holds(self, key: Any) -> bool:
        return tuple(key) in self._state.facts

    def value(self, key: Any) -> Optional[float]:
        return self._state.values.get(tuple(key))

    def objects(self, types: Tuple[str, ...]) -> List[str]:
        return [
            name
            for name, kind in self._model.objects.items()
            if any(self._model._is_a(kind, wanted) for wanted in types)
        ]


class World(DispatchEnvironment):
    """:param durations: s that each action lasts, by number.
    :param latency: s, at most, that anything takes to arrive.
    :param lists: whether the knowledge base tells which actions have begun, and refuses an end without its
        conditions, as ours does.
    """

    def __init__(
        self,
        plan: Planned,
        durations: Sequence[float],
        rng: random.Random,
        latency: float = 0.004,
        lists: bool = True,
    ) -> None:
        self.time = 0.0
        self.state = plan.model.initial.copy()
        self.events: List[Event] = []
        self.sent: List[Tuple[float, int]] = []
        self.queue = Events(self)
        self._plan = plan
        self._durations = durations
        self._random = rng
        self._latency = latency
        self._agenda: List[Tuple[float, int, Callable[[], None]]] = []
        self._count = itertools.count()
        self._cancelled: Dict[int, bool] = {}
        self._begun: Set[int] = set()
        self._lists = lists
        self._wake: Optional[float] = None
        for number, timed in enumerate(plan.model.timed):
            self._at(timed.time, lambda number=number: self._timed(number))

    def run(self, kind: str, limits: Optional[DispatchLimits] = None) -> Outcome:
        """Dispatches the plan."""
        dispatch = PlanDispatch(
            self._plan.schedule(kind), self, limits or DispatchLimits(), PLAN_ID, events=self.queue
        )
        report = dispatch.run()
        return Outcome(report, self.events, self.state, self.sent)

    def step(self, end: float) -> bool:
        """Lets the next thing happen, if it comes before `end`; else that becomes the time."""
        if not self._agenda or self._agenda[0][0] > end:
            self.time = max(self.time, end)
            return False
        self.time, _, happen = heapq.heappop(self._agenda)
        happen()
        return True

    # --- what happens ---------------------------------------------------------------------------

    def _at(self, time: float, happen: Callable[[], None]) -> None:
        heapq.heappush(self._agenda, (max(time, self.time), next(self._count), happen))

    def _soon(self, happen: Callable[[], None], after: float = 0.0) -> float:
        time = max(after, self.time) + self._random.uniform(0.1, 1.0) * self._latency
        self._at(time, happen)
        return time

    def _timed(self, number: int) -> None:
        self.events.append(Event(self.time, "timed", number))
        self._apply([self._plan.model.timed[number].effect])

    def _apply(self, effects: List[Any]) -> None:
        before = self.state
        self.state = self._plan.model.apply(effects, before)
        names = {key[0] for key in before.facts ^ self.state.facts}
        names |= {k[0] for k, v in self.state.values.items() if before.values.get(k) != v}
        if names or self._lists:
            self._soon(lambda: self.queue.put(KnowledgeChanged(frozenset(names))))

    def _answer(self, number: int, status: FeedbackStatus, reason: str = "") -> None:
        self.queue.put(Feedback(number, int(status), PLAN_ID, reason))

    def _begin(self, number: int) -> None:
        if self._cancelled.get(number):
            return
        action = self._plan.actions[number]
        self._begun.add(number)
        if self._changes_at_start(number):
            self.events.append(Event(self.time, "start", number))
            self._apply(action.effects["start"])
        self._at(self.time + self._durations[number], lambda: self._end(number))

    def _changes_at_start(self, number: int) -> bool:
        action = self._plan.actions[number]
        return action.durative and bool(action.effects["start"])

    def _end(self, number: int) -> None:
        if self._cancelled.get(number):
            return
        self._cancelled[number] = True  # a cancel comes too late
        action = self._plan.actions[number]
        if action.durative and self._lists and not self._holds(action.conditions["end"]):
            self._answer_soon(number, FeedbackStatus.FAILED, "at its end")
            return
        self.events.append(Event(self.time, "end", number))
        self._apply(action.effects["end" if action.durative else "start"])
        self._answer_soon(number, FeedbackStatus.SUCCEEDED)

    def _holds(self, conditions: Sequence[Tree]) -> bool:
        return all(self._plan.model.holds(condition, self.state) for condition in conditions)

    def _answer_soon(self, number: int, status: FeedbackStatus, reason: str = "") -> None:
        self._soon(lambda: self._answer(number, status, reason), self._latency + self.time)

    # --- what the dispatch asks -----------------------------------------------------------------

    def now(self) -> float:
        return self.time

    def deadline(self, seconds: Optional[float]) -> _Deadline:
        return _Deadline(self, seconds)

    def send(self, action: PlannedAction) -> None:
        self.sent.append((self.time, action.id))
        if not self._changes_at_start(action.id):  # all its start is, are conditions: checked just now
            self.events.append(Event(self.time, "start", action.id))
        taken = self._soon(lambda: self._soon(lambda: self._answer(action.id, FeedbackStatus.ENABLED)))
        self._soon(lambda: self._begin(action.id), taken)

    def send_cancel(self, action: PlannedAction) -> None:
        def stop() -> None:
            if not self._cancelled.get(action.id):
                self._cancelled[action.id] = True
                self._soon(lambda: self._answer(action.id, FeedbackStatus.FAILED))

        self._soon(stop)

    def close(self, action: PlannedAction) -> None:
        pass

    def publish_feedback(self, action: PlannedAction, status: FeedbackStatus) -> None:
        pass

    def operator(self, action: PlannedAction) -> ActionModel:
        return self._plan.operators[action.id]

    def false_of(self, action: PlannedAction, conditions: Conditions) -> Conditions:
        evaluator = Evaluator(self._plan.domain, _Stored(self._plan.model, self.state))
        values = {PlanTerm(key[0], key[1:]): value for key, value in self.state.values.items()}

        def holds(atom: PlanTerm) -> bool:
            if atom.name == "=":
                return len({each.lower() for each in atom.arguments}) == 1
            return self._plan.model.holds([atom.key.name, *atom.key.arguments], self.state)

        return Conditions(
            tuple(atom for atom in conditions.positive if not holds(atom)),
            tuple(atom for atom in conditions.negative if holds(atom)),
            tuple(entry for entry in conditions.comparisons if not comparison_holds(entry, values)),
            tuple(entry for entry in conditions.expressions if not evaluator.holds(entry.condition)),
        )

    def next_change(self, names: FrozenSet[str], until: float) -> Optional[float]:
        times = [
            timed.time
            for timed in self._plan.model.timed
            if self.time < timed.time <= until and _name(timed.effect) in names
        ]
        return max(times, default=None)

    def begun(self, action: PlannedAction) -> Optional[bool]:
        return action.id in self._begun if self._lists else None

    def seconds_silent(self, operator: str) -> Optional[float]:
        return 0.0

    def just_announced(self, operator: str) -> bool:
        return False

    def wake_at(self, when: Optional[float]) -> None:
        if when == self._wake:
            return
        self._wake = when
        if when is not None:

            def ring() -> None:
                if self._wake == when:
                    self._wake = None
                    self.queue.put(Tick())

            self._at(when, ring)

    def changed(self, report: DispatchReport) -> None:
        pass


def _name(effect: Any) -> str:
    return str(effect[1][0] if effect[0] in ("not", "=") else effect[0])

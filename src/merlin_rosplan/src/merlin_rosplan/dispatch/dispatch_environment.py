# SPDX-License-Identifier: Apache-2.0
"""What a dispatch reports and needs: states, report, the events that it reacts to, and its environment."""

import abc
import threading
from dataclasses import dataclass
from enum import IntEnum
from typing import (
    TYPE_CHECKING,
    AbstractSet,
    Any,
    Callable,
    FrozenSet,
    List,
    Mapping,
    NamedTuple,
    Optional,
    Sequence,
    Tuple,
    Union,
)

from merlin_rosplan.dispatch.dispatch_schedule import Ongoing, PlanError, PlannedAction

if TYPE_CHECKING:  # a dispatcher answers before it has operators
    from merlin_rosplan.dispatch.dispatch_graph import GraphSchedule
    from merlin_rosplan.dispatch.operator_model import ActionModel, Conditions, PlanTerm


class FeedbackStatus(IntEnum):
    """Status in an ActionFeedback."""

    PRECONDITION_FALSE = 0
    ENABLED = 1
    SUCCEEDED = 2
    DISPATCHED_TO_START_STATE = 3
    FAILED = 10


class DispatchState(IntEnum):
    """State of a dispatch; the first ones have the numbers of merlin_msgs/DispatchStatus."""

    IDLE = 0
    RUNNING = 1
    CANCELLING = 2
    SUCCEEDED = 3
    FAILED = 4
    CANCELLED = 5


class DispatchError(Exception):
    """Something outside does not work (the knowledge base does not answer, …); ends the dispatch."""


class PlanKnowledgeError(DispatchError):
    """The knowledge base does not answer, or does not know; the text says what."""


@dataclass(frozen=True)
class DispatchLimits:
    """Patience of a dispatcher, s, on the monotonic clock less the simulator's pauses; None: no limit.

    :param acknowledge: an action whose interface was never announced must be accepted within this time.
    :param accept: an action whose interface is alive must be accepted within this time.
    :param liveness: an interface that announced itself regularly and has been silent this long is dead.
    :param cancel: how long a cancelled action's interface may take to answer.
    :param over_all_grace: an action whose own end effects break its over-all condition reports its end within
        it.
    :param settle: within it an interface has applied the start effects of an action it was given, and a
        knowledge base a timed literal whose time has come; until then an action that needs them is not
        refused.
    """

    acknowledge: Optional[float] = 2.0
    accept: Optional[float] = 10.0
    liveness: Optional[float] = 5.0
    cancel: Optional[float] = 5.0
    over_all_grace: float = 1.0
    settle: float = 2.0


@dataclass(frozen=True)
class DispatchFailure:
    """Why a dispatch stops before its end, a sentence, and the action that failed.

    SUCCEEDED: what it was for came true by itself.
    """

    state: DispatchState
    reason: str
    action: Optional[PlannedAction] = None


@dataclass(frozen=True)
class DispatchReport:
    """How a dispatch stands, or how it ended.

    :param goal_achieved: whether every goal held at its end.
    :param unmet_goals: those that did not, as PDDL text.
    """

    state: DispatchState
    reason: str
    running: Tuple[PlannedAction, ...] = ()
    steps_done: int = 0
    steps_total: int = 0
    failed_action: Optional[PlannedAction] = None
    unanswered: Tuple[PlannedAction, ...] = ()
    goal_achieved: bool = False
    unmet_goals: Tuple[str, ...] = ()

    @staticmethod
    def of(
        state: Optional[DispatchState],
        failure: Optional[DispatchFailure],
        schedule: "GraphSchedule",
        running: Sequence[PlannedAction],
        steps_done: int,
        unanswered: Sequence[PlannedAction],
        unstopped: Sequence[PlannedAction] = (),
    ) -> "DispatchReport":
        """The report of a dispatch.

        :param state: None: what follows from the rest.
        :param failure: why it stops; None: it continues, or every action has ended.
        :param unanswered: actions whose interfaces did not answer the cancel.
        :param unstopped: actions whose interfaces answered that they did not stop.
        """
        stopped = not unanswered and not unstopped
        total = len(schedule.actions)
        reason = failure.reason if failure is not None else f"{steps_done} of {total} actions done"
        if state is None:
            if failure is None:
                state = DispatchState.RUNNING if running or not schedule.finished else DispatchState.SUCCEEDED
            elif failure.state == DispatchState.CANCELLED and schedule.finished and stopped:
                state = DispatchState.SUCCEEDED
                reason = "the last action had ended when the cancel came through"
            else:
                state = failure.state
                if not stopped and state == DispatchState.SUCCEEDED:
                    state = DispatchState.FAILED
        if unstopped:
            reason += f"; {', '.join(map(str, unstopped))} did not stop"
        if unanswered:
            reason += f"; no answer to the cancel from {', '.join(map(str, unanswered))}"
        failed = failure.action if failure is not None else None
        return DispatchReport(state, reason, tuple(running), steps_done, total, failed, tuple(unanswered))

    @property
    def success(self) -> bool:
        """Whether every action of the plan succeeded, or was not needed any more."""
        return self.state == DispatchState.SUCCEEDED


class PlanGoals(NamedTuple):
    """What a plan is for."""

    literals: "Conditions"
    reads: FrozenSet[str] = frozenset()
    """Predicates and functions that the other goals depend on."""


class RestVerdict(NamedTuple):
    """The rest of a plan need not, or cannot, be carried out."""

    reason: str
    """One sentence."""
    achieved: bool = False
    """All goals hold."""
    action: Optional[PlannedAction] = None
    """The action that cannot start any more."""


class RestWatch(abc.ABC):
    """Watches whether the rest of a plan still fits the world. Used in the thread of the dispatch only."""

    @property
    @abc.abstractmethod
    def skipped(self) -> AbstractSet[int]:
        """Actions that are not needed any more."""

    @abc.abstractmethod
    def changed(self, change: "KnowledgeChanged") -> None:
        """The knowledge base has changed."""

    @abc.abstractmethod
    def started(self, action_id: int) -> None:
        """An action was sent."""

    @abc.abstractmethod
    def ended(self, action_id: int) -> None:
        """An action has succeeded, or was skipped."""

    @abc.abstractmethod
    def look(self) -> Optional[RestVerdict]:
        """Judges what has changed since the last look; None: the plan goes on."""


class DispatchEnvironment(abc.ABC):
    """What a dispatch needs from the world. Called in the thread that runs the dispatch only."""

    @abc.abstractmethod
    def now(self) -> float:
        """ROS time as it passes, s: how its clock is set meanwhile does not count."""

    @abc.abstractmethod
    def deadline(self, seconds: Optional[float]) -> Any:
        """A deadline with ``remaining()``; None means never."""

    @abc.abstractmethod
    def send(self, action: PlannedAction) -> None:
        """Dispatches an action."""

    @abc.abstractmethod
    def send_cancel(self, action: PlannedAction) -> None:
        """Sends a cancel to the action's interface."""

    def close(self, action: PlannedAction) -> None:
        """Publishes the tombstone, latched in place of the last action: a late subscriber gets that."""
        self.send_cancel(action)

    @abc.abstractmethod
    def publish_feedback(self, action: PlannedAction, status: FeedbackStatus) -> None:
        """Publishes the dispatcher's own feedback, if it publishes any."""

    @abc.abstractmethod
    def operator(self, action: PlannedAction) -> "ActionModel":
        """The ground operator of an action; raises DispatchError when it is unknown."""

    def false_of(self, action: PlannedAction, conditions: "Conditions") -> "Conditions":
        """Those of the action's conditions that do not hold now; raises DispatchError.

        A subclass has to have this or the next one.
        """
        return self.false_of_each([(action, conditions)])[0]

    def false_of_each(self, asked: "Sequence[Tuple[PlannedAction, Conditions]]") -> "List[Conditions]":
        """:meth:`false_of` for several actions at one moment, in their order."""
        return [self.false_of(action, conditions) for action, conditions in asked]

    def next_change(self, names: FrozenSet[str], until: float) -> Optional[float]:
        """The ROS time, s, of the last change of these names that the knowledge base waits for.

        Only changes that come up to `until` count; None: no such change.
        """
        return None

    def begun(self, action: PlannedAction) -> Optional[bool]:
        """Whether the start effects of an action that was sent are applied; None when that is not known.

        Asked after each change of the knowledge base while something waits for them.
        """
        try:
            held = self.held()
        except DispatchError:
            return None
        return None if held is None else action.id in held

    def held(self) -> "Optional[Mapping[int, FrozenSet[PlanTerm]]]":
        """The actions of this dispatch whose effects have begun and not ended, by id.

        With each the facts, lower-case, that are as they are only while it runs. None: not known.
        """
        return None

    def goals(self) -> "Optional[PlanGoals]":
        """What the plan is for; None when it is not known."""
        return None

    def goals_hold(self) -> bool:
        """Whether there are goals, and all hold now."""
        return False

    def objects(self) -> Optional[FrozenSet[str]]:
        """All objects and constants, lower-case; None when they are not known."""
        return None

    def robot_left(self, action: PlannedAction, unmet: "Conditions") -> str:
        """The robot of an action that cannot start because that robot takes no actions; empty: it does."""
        return ""

    @abc.abstractmethod
    def seconds_silent(self, operator: str) -> Optional[float]:
        """Seconds since the operator's interface last announced itself; None when it never has."""

    def has_left(self, action: PlannedAction) -> bool:
        """Whether the node that has taken the action has closed the connection over which it said so."""
        return False

    @abc.abstractmethod
    def just_announced(self, operator: str) -> bool:
        """Whether the operator's interface announced itself for the first time only seconds ago."""

    @abc.abstractmethod
    def wake_at(self, when: Optional[float]) -> None:
        """Asks for a :class:`Tick` at a ROS time, s; None takes the wish back."""

    @abc.abstractmethod
    def changed(self, report: DispatchReport) -> None:
        """Takes how the dispatch stands now."""


class Feedback(NamedTuple):
    """An action interface reports."""

    action_id: int
    status: int
    plan_id: int = 0
    reason: str = ""
    robot: str = ""
    """The robot that no longer takes actions, which is why this one failed; those of others continue."""
    unstopped: bool = False
    """Whether it failed because it was cancelled and did not stop."""


class CancelRequest(NamedTuple):
    """A request to stop the dispatch."""

    reason: str


class KnowledgeChanged(NamedTuple):
    """The knowledge base changed; `names` of predicates and functions, None when it does not say.

    No names: something was applied that changed nothing. The empty name stands for objects.
    """

    names: Optional[FrozenSet[str]] = None
    facts: FrozenSet[Tuple[Tuple[str, ...], bool]] = frozenset()
    """The facts among the changes, as predicate and objects in lower case, and whether each holds now."""


def together(names: Optional[FrozenSet[str]], more: Optional[FrozenSet[str]]) -> Optional[FrozenSet[str]]:
    """Names that changed; None stands for all."""
    return None if names is None or more is None else names | more


class Exchange:
    """A wish that another plan takes the place of what has not begun. Thread-safe.

    :param keep: ids of the actions that go on.
    :param make: called in the dispatch's thread; gives the new schedule, in which what runs and is part of it
        has kept its ids, and its watch. May raise PlanError or DispatchError: the plan of before goes on.
    :param known: ids of the actions that had begun when the plan was made; None: all that have begun now.
    """

    def __init__(
        self,
        keep: FrozenSet[int],
        make: "Callable[[Ongoing], Tuple[GraphSchedule, Optional[RestWatch]]]",
        known: Optional[FrozenSet[int]] = None,
    ) -> None:
        self.keep = keep
        self._known = known
        self.make = make
        self.ended = threading.Event()
        self.refusal = ""  # of use once it has ended: why it was not carried out, one sentence
        self._lock = threading.Lock()  # guards the field below
        self._open = True

    def take_back(self) -> bool:
        """Its client no longer waits; False: it was taken, and its end follows."""
        with self._lock:
            taken, self._open = self._open, False
        return taken

    def carry_out(self, act: "Callable[[Exchange], str]") -> None:
        """Ends it, unless it was taken back.

        :param act: returns why it was not carried out, or raises that; empty: it was.
        """
        if not self.take_back():
            return
        self.refusal = "the plan cannot be exchanged"
        try:
            self.refusal = act(self)
        except (PlanError, DispatchError) as error:
            self.refusal = str(error)
        finally:
            self.ended.set()

    def ongoing(
        self, running: Sequence[PlannedAction], succeeded: AbstractSet[int], used: AbstractSet[int]
    ) -> Ongoing:
        """The actions that run, sorted.

        :param succeeded: ids of the actions that have.
        :param used: all ids that any action has had.
        :raises PlanError: one that shall go on neither runs nor is among those that have succeeded, by ids;
            or one has begun and ended since the plan was made, which would be done again.
        """
        lost = self.keep - succeeded - {action.id for action in running}
        if lost:
            ids = ", ".join(map(str, sorted(lost)))
            raise PlanError(f"the plan counts on action {ids}, which neither runs nor has succeeded")
        known = used if self._known is None else self._known | self.keep
        over = succeeded - known
        if over:
            ids = ", ".join(map(str, sorted(over)))
            raise PlanError(f"action {ids} has begun and ended since the plan was made")
        kept = tuple(action for action in running if action.id in self.keep)
        others = tuple(action for action in running if action.id not in self.keep)
        return Ongoing(kept, others, used, {action.id for action in others} - known)


class Tick(NamedTuple):
    """The time asked for by ``wake_at`` has come."""


Event = Union[Feedback, CancelRequest, KnowledgeChanged, Exchange, Tick]

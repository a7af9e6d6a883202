# SPDX-License-Identifier: Apache-2.0
"""What is known of one dispatch from its messages: the dispatched actions and their answers.

Pure: messages go in as plain values. :mod:`merlin_planning.dispatch_client` is the ROS side of it.
"""

from enum import IntEnum
from typing import (
    Any,
    Callable,
    Container,
    Dict,
    Iterable,
    List,
    Mapping,
    NamedTuple,
    Optional,
    Sequence,
    Set,
    Tuple,
)

from merlin_pddl.plan_text import call_text

PART = "the planning system's plan dispatcher"
#: Name of a dispatched action that cancels another one, or all of them.
CANCEL_ACTION = "cancel_action"
Ground = Tuple[str, Tuple[str, ...]]
NO_REASON = "no reason given"
#: Key of an answer's information; its value :data:`NO` says that the action could not be stopped.
STOPPED = "stopped"
NO = "no"
#: Another key: another try of the action cannot help. Its value is the actions of which that is true, as PDDL
#: text with ``*`` for any argument, or :data:`YES`: this action.
FINAL = "final"
YES = "yes"
#: Another key, of one robot among several: the same operator by this robot with any arguments, as PDDL text.
OF_ROBOT = "of_robot"
#: A key of an action that goes on; its value :data:`NO` says that a more urgent request has to wait for it.
INTERRUPTIBLE = "interruptible"
#: Actions whose early answers are kept at most; any node may answer anything.
EARLY = 1000
_CANCELLED = "cancelled"
_UNANSWERED = "no answer to the cancel from "


class DispatchAnswer(IntEnum):
    """What an action interface says of an action, by its number in rosplan_dispatch_msgs/ActionFeedback."""

    TAKEN = 1
    SUCCEEDED = 2
    FAILED = 10


class DispatchResult(NamedTuple):
    """How a dispatch ended."""

    goal_achieved: bool
    cancelled: bool = False
    timed_out: bool = False
    """The dispatch did not end in time after a cancel."""
    action: str = ""
    """The action that failed, as PDDL text."""
    reason: str = ""
    unstopped: Tuple[str, ...] = ()
    """Actions that may still run, as PDDL text: they were cancelled and did not stop, or nothing answered."""
    gone: bool = False
    """The dispatcher is not there, or does not answer."""
    unmet: Tuple[str, ...] = ()
    """Goals that did not hold when it ended, as PDDL text; empty also when the dispatcher does not say."""
    no_retry: str = ""
    """Which actions another try cannot help, as PDDL text with ``*`` for any argument; empty: it may help."""
    of_robot: str = ""
    """The same operator by the robot whose action failed, likewise; empty: no robot is named."""
    held_up_by: str = ""
    """What did not stop below `unstopped`, as their interfaces say; empty: they do not say."""


class Reply(NamedTuple):
    """What the dispatcher's service has answered."""

    achieved: bool = False
    """It says that the goal holds, which says nothing of what was to stop."""
    refused: str = ""
    """Its words when it did not take the plan."""
    gone: str = ""
    """Why there is no answer, as a sentence."""


class Action(NamedTuple):
    """An action that a dispatcher has sent."""

    id: int
    plan_id: int
    name: str
    arguments: Tuple[str, ...]
    message: Any = None
    """What the owner of the book wants back for it."""
    ends: float = 0.0
    """ROS time at which it is to end as planned, s."""

    @property
    def ground(self) -> Ground:
        """For comparison with the plan."""
        return ground(self.name, self.arguments)

    @property
    def text(self) -> str:
        """The action as PDDL text: ``(navigate hall kitchen)``."""
        return call_text(self.name, self.arguments)


class EarlyAnswer(NamedTuple):
    """An answer that came before the action itself, which travels over another connection."""

    plan_id: int
    answer: DispatchAnswer
    information: Mapping[str, str]


def ground(name: str, arguments: Sequence[str]) -> Ground:
    """A ground action; names do not depend on case."""
    return name.lower(), tuple(argument.lower() for argument in arguments)


class DispatchProgress:
    """The book of one dispatch. Not thread-safe."""

    def __init__(self) -> None:
        self.messages = 0
        """Messages that counted for this dispatch."""
        self.running: Dict[int, Action] = {}
        self.kept: Set[int] = set()
        """Ids of those of them for which a more urgent request has to wait."""
        self.succeeded: Set[int] = set()
        """Ids of the actions that have succeeded, since the present plan began."""
        self.ended: Set[int] = set()
        """Ids of all actions that have ended, also those of plans that were exchanged."""
        self.failed = ""
        """The action that failed last, as PDDL text."""
        self.failed_reason = ""
        self.failed_by_itself = False
        """Whether an action failed before the dispatch was to be cancelled."""
        self._seen: Optional[Ground] = None
        self._stopping = False
        self._taken: Set[int] = set()
        self._early: Dict[int, List[EarlyAnswer]] = {}  # action id -> answers, the first of them TAKEN
        self._found: Set[int] = set()  # ids of actions that may still be seen to be dispatched
        self._unstopped: Dict[str, str] = {}  # its text → what its interface says
        self._no_retry: Dict[str, str] = {}  # a failed action -> which actions cannot help
        self._of_robot: Dict[str, str] = {}  # likewise -> the same operator by its robot
        self._counted: Optional[Container[int]] = None  # actions whose failure counts; None: all

    @property
    def under_way(self) -> List[Action]:
        """The actions that run, in the order in which they are to end."""
        return sorted(self.running.values(), key=lambda action: action.ends)

    @property
    def begun(self) -> bool:
        """Whether an action was seen."""
        return self._seen is not None

    @property
    def other_plan(self) -> bool:
        """Whether the dispatcher carries out an older plan than the one that was meant."""
        return False

    @property
    def patience(self) -> Optional[float]:
        """How long it may send nothing until it is given up, s of running time; None: it is not."""
        return None

    def stop(self) -> None:
        """The dispatch is to be cancelled: an action that fails from now on was cancelled."""
        self._stopping = True

    def exchange(self, counted: Container[int]) -> Callable[[], None]:
        """Another plan is to take the place of the rest; the steps done count anew.

        :param counted: ids of the actions of the new plan and of those that go on; one of these may have
            succeeded meanwhile. The others are cancelled by the dispatcher, which is no failure.
        :return: takes it back.
        """
        done, before = self.succeeded, self._counted
        self.succeeded, self._counted = {each for each in done if each in counted}, counted

        def take_back() -> None:
            self.succeeded, self._counted = self.succeeded | done, before

        return take_back

    def stand_still(self, seconds: float) -> None:
        """The dispatch is given up: nothing was under way, nothing failed, and it did not end."""
        lost = ", ".join(action.text for action in self.running.values())
        why = f", and nothing takes {lost}" if lost else ""
        self.failed_reason = f"{PART} has sent nothing for {seconds:g} s{why}"
        self.failed_by_itself = True

    def dispatched(self, action: Action) -> None:
        """An action was dispatched; what has been answered to it before counts now."""
        if action.id in self._found or action.id in self.running:  # it was sent again
            return
        self.messages += 1
        if self._seen is None:
            self._seen = action.ground
        self.running[action.id] = action
        for early in self._early.pop(action.id, []):
            self.answered(action.id, *early)

    def find(self, actions: Iterable[Action]) -> None:
        """Those of these actions that were missed, and that an interface says it runs, are dispatched."""
        for action in actions:
            answers = self._early.get(action.id, ())
            if len(answers) == 1 and answers[0].plan_id in (0, action.plan_id):
                self.dispatched(action)
                self._found.add(action.id)

    def answered(
        self, action_id: int, plan_id: int, answer: DispatchAnswer, information: Mapping[str, str]
    ) -> bool:
        """An action interface has answered.

        :param plan_id: 0 when it does not say.
        :param information: that came with the answer.
        :return: whether that ends an action of this dispatch, or says of one whether it can be interrupted.
        """
        action = self.running.get(action_id)
        if action is None:
            self._keep(action_id, EarlyAnswer(plan_id, answer, information))
            return False
        if plan_id not in (0, action.plan_id):
            return False
        self.messages += 1
        if answer is DispatchAnswer.TAKEN:
            self._taken.add(action_id)
            kept = information.get(INTERRUPTIBLE)
            (self.kept.add if kept == NO else self.kept.discard)(action_id)
            return kept is not None
        del self.running[action_id]
        self.ended.add(action_id)
        self.kept.discard(action_id)
        if answer is DispatchAnswer.SUCCEEDED:
            self.succeeded.add(action_id)
            return True
        reason = information.get("reason", NO_REASON)
        if information.get(STOPPED, "").lower() == NO:
            self._unstopped[action.text] = "" if reason in (_CANCELLED, NO_REASON) else reason
        if self._counted is not None and action_id not in self._counted:
            return True
        final = information.get(FINAL, "")
        if final:
            self._no_retry[ground_text(action.text)] = action.text if final.lower() == YES else final
        self._of_robot[ground_text(action.text)] = information.get(OF_ROBOT, "")
        if not self.failed or self.failed_reason == _CANCELLED:
            self.failed, self.failed_reason = action.text, reason
        if not self._stopping and reason != _CANCELLED:
            self.failed_by_itself = True
        return True

    def _keep(self, action_id: int, early: EarlyAnswer) -> None:
        """Keeps the answers to an action from the one that takes it on.

        Others belong to an action of before: ROSPlan counts from 0 in each plan.
        """
        if early.answer is DispatchAnswer.TAKEN:
            self._early.pop(action_id, None)
            self._early[action_id] = [early]
            if len(self._early) > EARLY:
                del self._early[next(iter(self._early))]
        elif len(self._early.get(action_id, [])) == 1:
            self._early[action_id].append(early)

    @property
    def unanswered(self) -> List[str]:
        """Actions that an interface took and has not answered, as PDDL text."""
        return [action.text for action in self.running.values() if action.id in self._taken]

    @property
    def _dropped(self) -> List[str]:
        """Actions that run and that another plan does without, which are cancelled too, as PDDL text."""
        return [
            each.text
            for each in self.running.values()
            if self._counted is not None and each.id not in self._counted
        ]

    def answers_missing(self, failed: str, achieved: bool = False) -> bool:
        """Whether answers are still to come at the end of a dispatch.

        After a cancel each action has one, which says whether it has stopped.

        :param failed: the action that failed, when the dispatcher names one: of that one, what was said may
            be under way altogether.
        :param achieved: whether every goal holds: then only what was to stop has to say that it has.
        """
        if self._stopping:
            return bool(self.running)
        if achieved:
            return bool(self._dropped)
        texts = [ground_text(action.text) for action in self.running.values()]
        return bool(self.unanswered) or (bool(failed) and ground_text(failed) in texts)

    def unstopped(self, cancelled: bool, reason: str = "") -> Tuple[str, ...]:
        """Actions that may still run after the end of the dispatch, as PDDL text.

        :param cancelled: whether it was cancelled: what has not answered then may still run. Otherwise its
            interface has died, and the one that returns in its place puts things right.
        :param reason: the dispatcher's, which names what did not answer it.
        """
        names = [*self._unstopped, *self._dropped]
        if cancelled:
            names += self.unanswered
            if _UNANSWERED in reason:
                names += _texts(reason.split(_UNANSWERED, 1)[1])
        return tuple(dict.fromkeys(names))

    def result(
        self, reply: Reply, action: str = "", reason: str = "", unmet: Sequence[str] = ()
    ) -> DispatchResult:
        """How the dispatch has ended.

        :param action: that failed, when the dispatcher names one.
        :param reason: the dispatcher's; empty when it publishes none.
        :param unmet: goals that do not hold, when it names them.
        """
        cancelled = self._stopping and not self.failed_by_itself
        unstopped = self.unstopped(self._stopping, reason)
        if reply.achieved and not unstopped:
            return DispatchResult(True, cancelled)
        why = reason or self.failed_reason or "the plan ended, but the goal does not hold"
        if reply.refused or reply.gone:
            action, why = "", reply.refused or reply.gone
        named = action or ("" if reply.gone and not self.failed_by_itself else self.failed)
        no_retry, of_robot = (found.get(ground_text(named), "") for found in (self._no_retry, self._of_robot))
        said = "; ".join(filter(None, dict.fromkeys(self._unstopped.values())))
        return DispatchResult(
            False,
            cancelled,
            False,
            named,
            why,
            unstopped,
            bool(reply.gone),
            tuple(unmet),
            no_retry,
            of_robot,
            said,
        )

    def hung(self, dispatcher: str, deadline: float) -> DispatchResult:
        """The end of a dispatch whose dispatcher does not say that it has ended.

        :param dispatcher: its name.
        :param deadline: s that it had.
        """
        running = tuple(action.text for action in self.running.values())
        if self.failed_by_itself and not self._stopping and not running:
            reason = f"{self.failed_reason}, and {PART} {dispatcher} does not answer"
            return DispatchResult(False, action=self.failed, reason=reason, gone=True)
        names = tuple(dict.fromkeys([*self.unstopped(True), *running]))
        hung = f"{', '.join(names)} did not stop: " if names else ""
        reason = f"{hung}{PART} {dispatcher} did not end its plan within {deadline:g} s"
        return DispatchResult(False, self._stopping, True, ", ".join(names), reason, names or (PART,))


def unmet_reason(goals: Sequence[str]) -> str:
    """Why a dispatch has failed whose actions have all succeeded.

    :param goals: those that do not hold, as PDDL text.
    """
    return f"these goals do not hold: {', '.join(goals)}"


def ground_text(text: str) -> str:
    """PDDL text for comparison: names do not depend on case."""
    return " ".join(text.lower().split())


def _texts(listed: str) -> List[str]:
    """``(a b), (c d)`` → the two."""
    return [f"({part.split(')', 1)[0]})" for part in listed.split("(")[1:]]

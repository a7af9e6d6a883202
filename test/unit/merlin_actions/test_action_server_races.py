# SPDX-License-Identifier: Apache-2.0
"""The server of a machine, when a goal ends in the moment in which it is preempted, or cannot be answered."""

import threading
from types import SimpleNamespace
from typing import Any, Callable, Iterator, Tuple

import pytest
import rospy
from actionlib_msgs.msg import GoalID, GoalStatus
from diagnostic_msgs.msg import KeyValue
from fakes.topics import Topics
from merlin_msgs.msg import RunActionActionGoal, RunActionGoal

import smach
from merlin_actions import merlin_action_server
from merlin_actions.merlin_action_server import MerlinActionServer
from merlin_actions.merlin_action_sm import MerlinActionSM
from merlin_sm.states.merlin_state import SUCCEEDED, MerlinState
from merlin_test import LONG


class Wait(MerlinState):
    """Runs until a test lets it go on, or it is preempted."""

    def __init__(self) -> None:
        super().__init__()
        self.begun = threading.Semaphore(0)
        self.goes_on = threading.Event()
        self.obeys = True

    def run(self, userdata: Any) -> str:
        if self.obeys:
            self.interruptible(self.goes_on.set)
        self.begun.release()
        assert self.goes_on.wait(LONG)
        self.interruptible(None)
        self.goes_on.clear()
        return "preempted" if self.preempt_requested() else SUCCEEDED


class Drive(MerlinActionSM):
    parameters = ["to"]

    def build(self) -> None:
        self.waits = Wait()
        self.add("WAIT", self.waits)


class Deliver(MerlinActionSM):
    """Drives, grasps in a machine of its own, and hands over; it is not interrupted everywhere."""

    parameters = ["to"]
    safe_to_interrupt = ["DRIVE", "LOOK"]

    def build(self) -> None:
        self.add("DRIVE", self.done(), transitions={SUCCEEDED: "GRASP"})
        grasp = smach.StateMachine([SUCCEEDED, "aborted", "preempted"])
        with grasp:
            smach.StateMachine.add("LOOK", self.done(), transitions={SUCCEEDED: "HOLD"})
            smach.StateMachine.add("HOLD", self.done())
        self.add("GRASP", grasp)

    @staticmethod
    def done() -> Wait:
        waits = Wait()
        waits.goes_on.set()
        return waits


class Misspelt(Deliver):
    safe_to_interrupt = ["DRIVES"]


class Odd(MerlinState):
    """Gives up, and says of itself what is not text."""

    def run(self, userdata: Any) -> str:
        if userdata.to == "error":
            return self.give_up(ValueError("there is no cup"))  # type: ignore[arg-type]
        self.unstopped = ["the arm"]  # type: ignore[assignment]
        self.given_up = self.reason = 5  # type: ignore[assignment]
        return "aborted"


class Fetch(MerlinActionSM):
    parameters = ["to"]

    def build(self) -> None:
        self.add("ODD", Odd(input_keys=["to"]))


class Served:
    """A machine that is served, and its client."""

    def __init__(self, topics: Topics, machine: MerlinActionSM, cancel_limit: float) -> None:
        self.topics = topics
        self.server = MerlinActionServer(machine, cancel_limit)
        self.server.start()
        self._name = f"/actions/{self.server.operator.lower()}"

    def send(self, goal: str, to: str = "hall") -> None:
        message = RunActionActionGoal(goal_id=GoalID(id=goal, stamp=rospy.Time(1)))
        message.goal = RunActionGoal(parameters=[KeyValue("to", to)])
        self.topics.send(f"{self._name}/goal", message)

    def cancel(self, goal: str) -> None:
        self.topics.send(f"{self._name}/cancel", GoalID(id=goal))

    def answer(self) -> Tuple[str, int, str]:
        """Goal, status and reason of the next result."""
        result = self.topics.published(f"{self._name}/result").get(timeout=LONG)
        return result.status.goal_id.id, result.status.status, result.result.reason

    @property
    def waits(self) -> Wait:
        """The state of the present machine."""
        return self.server.machine.waits  # type: ignore[attr-defined, no-any-return]

    def begun(self) -> bool:
        """Waits until a run has begun."""
        return self.waits.begun.acquire(timeout=LONG)


@pytest.fixture
def serve(monkeypatch: pytest.MonkeyPatch, clock: Any) -> Iterator[Callable[..., Served]]:
    shown = SimpleNamespace(stop=lambda: None)
    monkeypatch.setattr(merlin_action_server, "start_introspection", lambda name, machine: shown)
    for name in ("set_param", "loginfo", "logwarn", "logerr"):
        monkeypatch.setattr(rospy, name, lambda *_: None)
    topics = Topics(monkeypatch)
    made = []

    def serve(machine: MerlinActionSM, cancel_limit: float = 0.0) -> Served:
        made.append(Served(topics, machine, cancel_limit))
        return made[-1]

    yield serve
    for each in made:
        each.server.shutdown()


@pytest.fixture
def drive(serve: Callable[..., Served]) -> Served:
    return serve(Drive())


def no_thread(thread: threading.Thread) -> None:
    raise RuntimeError("can't start new thread")


def test_a_goal_that_ends_while_it_is_cancelled_is_answered_once_and_costs_the_next_nothing(
    drive: Served,
) -> None:
    def before(topic: str, message: Any) -> None:
        if topic.endswith("/result") and message.status.goal_id.id == "a":
            drive.cancel("a")

    drive.topics.before = before
    drive.send("a")
    assert drive.begun()
    drive.waits.goes_on.set()
    assert drive.answer()[:2] == ("a", GoalStatus.SUCCEEDED)
    drive.send("b")
    assert drive.begun()
    drive.waits.goes_on.set()
    assert drive.answer()[:2] == ("b", GoalStatus.SUCCEEDED)


def test_a_machine_says_at_which_states_it_is_not_interrupted(serve: Callable[..., Served]) -> None:
    deliver = serve(Deliver())
    deliver.send("a")
    assert deliver.answer()[1] == GoalStatus.SUCCEEDED
    reported = deliver.topics.published("/actions/deliver/feedback")
    feedback = [reported.get(timeout=LONG).feedback for _ in range(reported.qsize())]
    assert [(each.state, each.uninterruptible) for each in feedback] == [
        ("DELIVER/DRIVE", False),
        ("DELIVER/GRASP", True),
        ("DELIVER/GRASP/LOOK", False),
        ("DELIVER/GRASP/HOLD", True),
    ]


def test_a_state_that_the_machine_does_not_have_is_named() -> None:
    with pytest.raises(ValueError, match="safe_to_interrupt names DRIVES"):
        Misspelt()


@pytest.mark.parametrize(("safe", "accepted"), [("BOTH", True), ("GRASP", True), ("HOLD", False)])
def test_a_state_that_is_not_reported_cannot_be_one_at_which_it_is_interrupted(
    serve: Callable[..., Served], safe: str, accepted: bool
) -> None:
    class Both(Deliver):
        safe_to_interrupt = [safe]

        def build(self) -> None:
            self.add("BOTH", smach.Concurrence([SUCCEEDED, "aborted", "preempted"], SUCCEEDED))
            with self["BOTH"]:
                grasp = smach.StateMachine([SUCCEEDED])
                smach.Concurrence.add("GRASP", grasp)
            with grasp:
                smach.StateMachine.add("HOLD", smach.CBState(lambda _: SUCCEEDED, outcomes=[SUCCEEDED]))

    if not accepted:
        with pytest.raises(ValueError, match="safe_to_interrupt names HOLD.*name the Concurrence"):
            Both()
        return
    both = serve(Both())
    both.send("a")
    assert both.answer()[1] == GoalStatus.SUCCEEDED
    feedback = both.topics.published("/actions/both/feedback")
    assert False in [feedback.get(timeout=LONG).feedback.uninterruptible for _ in range(feedback.qsize())]


def test_a_goal_that_is_cancelled_while_it_arrives_is_answered_once(drive: Served) -> None:
    for number in range(50):
        goal = str(number)
        cancels = threading.Thread(target=drive.cancel, args=(goal,))
        cancels.start()
        drive.send(goal)
        answered, status, _ = drive.answer()
        cancels.join(LONG)
        assert answered == goal and status in (GoalStatus.PREEMPTED, GoalStatus.RECALLED)
    assert drive.topics.published("/actions/drive/result").empty()


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_goal_that_cannot_be_answered_does_not_keep_the_next_one(drive: Served) -> None:
    def before(topic: str, message: Any) -> None:
        if topic.endswith("/result") and message.status.goal_id.id == "a":
            raise ValueError("this cannot be told")

    drive.topics.before = before
    drive.send("a")
    assert drive.begun()
    drive.send("b")
    assert drive.begun(), "the next goal never began"
    drive.waits.goes_on.set()
    assert drive.answer()[:2] == ("b", GoalStatus.SUCCEEDED)


def test_a_machine_that_cannot_begin_is_answered_and_keeps_no_next_goal(
    drive: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as short_of_threads:
        short_of_threads.setattr(threading.Thread, "start", no_thread)
        drive.send("a")
    goal, status, reason = drive.answer()
    assert (goal, status) == ("a", GoalStatus.ABORTED) and "can't start new thread" in reason
    drive.send("b")
    assert drive.begun(), "the next goal never began"
    drive.waits.goes_on.set()
    assert drive.answer()[:2] == ("b", GoalStatus.SUCCEEDED)


def test_a_machine_is_preempted_where_no_thread_can_be_started(
    drive: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    drive.send("a")
    assert drive.begun()
    with monkeypatch.context() as short_of_threads:
        short_of_threads.setattr(threading.Thread, "start", no_thread)
        drive.cancel("a")
    assert drive.answer()[:2] == ("a", GoalStatus.PREEMPTED)


def test_another_machine_takes_the_place_of_one_that_does_not_stop(serve: Callable[..., Served]) -> None:
    drive = serve(Drive(), 0.05)
    stuck = drive.waits
    stuck.obeys = False
    drive.send("a")
    assert drive.begun()
    drive.send("b")
    goal, status, reason = drive.answer()
    assert (goal, status) == ("a", GoalStatus.ABORTED)
    assert "drive in state WAIT did not stop within 0.05 s" in reason
    assert drive.waits is not stuck and drive.begun()
    drive.waits.goes_on.set()
    assert drive.answer()[:2] == ("b", GoalStatus.SUCCEEDED)
    stuck.goes_on.set()


def test_a_machine_that_hangs_before_it_begins_is_abandoned_too(serve: Callable[..., Served]) -> None:
    prepares, goes_on = threading.Event(), threading.Event()

    class Slow(Drive):
        def prepare(self) -> None:
            prepares.set()
            assert goes_on.wait(LONG)
            super().prepare()

    drive = serve(Slow(), 0.05)
    arrives = threading.Thread(target=drive.send, args=("a",))
    arrives.start()
    assert prepares.wait(LONG)
    drive.cancel("a")
    assert drive.answer()[:2] == ("a", GoalStatus.ABORTED)
    goes_on.set()
    arrives.join(LONG)
    drive.send("b")
    assert drive.begun()
    drive.waits.goes_on.set()
    assert drive.answer()[:2] == ("b", GoalStatus.SUCCEEDED)


@pytest.mark.parametrize("kind", ["error", "other"])
def test_a_state_that_ends_with_what_is_no_text_is_answered_and_keeps_no_next_goal(
    serve: Callable[..., Served], kind: str
) -> None:
    fetch = serve(Fetch())
    for goal in ("a", "b"):
        fetch.send(goal, kind)
        assert fetch.answer()[:2] == (goal, GoalStatus.ABORTED)

# SPDX-License-Identifier: Apache-2.0
"""A goal whose Executor is lost: it ends, or is sent again; and it always ends once."""

import queue
import threading
from types import SimpleNamespace
from typing import Any, Callable, Dict, List, Optional

import pytest
import rospy
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray
from hypothesis import given
from hypothesis import strategies as st
from merlin_msgs.msg import ExecuteGoal, ExecuteResult

from merlin_executor import resending as resending_rules
from merlin_executor.core import agenda as agenda_rules
from merlin_executor.core.agenda import Agenda, AgendaAnswer
from merlin_executor.core.outcome import Outcome, StopKind, Verdict
from merlin_executor.core.ticket import Ticket
from merlin_executor.executor_request import GOES_ON, ExecutorRequest
from merlin_executor.resending import END, RESEND, RESENDS, Resending
from merlin_ros import late_topics
from merlin_ros.actions.lease import LEASED, LOSE_AFTER, LeaseBook
from merlin_test import LONG


def test_by_default_a_lost_goal_ends() -> None:
    assert Resending().ended(lost=True) == ""


def test_a_goal_that_ended_by_itself_is_not_sent_again() -> None:
    assert Resending(RESEND).ended(lost=False) == ""


def test_a_lost_goal_is_sent_again_when_the_executor_is_back() -> None:
    resending = Resending(RESEND)
    assert resending.ended(lost=True) is None
    assert resending.executor(True) is None
    assert resending.sent_again == 1


def test_a_goal_that_no_executor_took_is_sent_again_whatever_its_client_wants() -> None:
    resending = Resending(END)
    assert resending.ended(lost=True, untaken=True) is None
    assert resending.executor(True) is None
    assert resending.ended(lost=True) is not None


def test_a_goal_that_is_cancelled_before_an_executor_took_it_ends_as_cancelled() -> None:
    resending = Resending(RESEND)
    resending.cancel()
    said = resending.ended(lost=True, untaken=True)
    verdict = resending.verdict(GoalStatus.LOST, "the action server never acknowledged the goal", "", said)
    assert verdict == Verdict(Outcome.CANCELLED, "cancelled before the executor took it")


def test_an_executor_that_stays_away_is_named() -> None:
    resending = Resending(RESEND)
    resending.ended(lost=True)
    decision = resending.executor(False)
    assert decision == "the executor is gone and did not return within 30 s"


def test_all_returns_of_an_executor_that_dies_again_and_again_have_one_deadline() -> None:
    now = [0.0]
    resending = Resending(RESEND, lambda: now[0])
    patience = []
    while resending.ended(lost=True) is None:
        patience.append(resending.patience)
        now[0] += 10.0
        assert resending.executor(True) is None
        now[0] += 5.0
    assert patience == [30.0, 15.0]


def test_a_cancelled_goal_is_never_sent_again() -> None:
    resending = Resending(RESEND)
    resending.cancel()
    assert resending.ended(lost=True) is not None
    resending = Resending(RESEND)
    resending.ended(lost=True)
    resending.cancel()
    assert resending.executor(True) == "cancelled while the executor was gone"


def test_what_to_do_has_to_be_a_known_word() -> None:
    with pytest.raises(ValueError, match="'again'.*end, resend"):
        Resending("again")


@given(st.sampled_from([END, RESEND]), st.lists(st.tuples(st.booleans(), st.booleans(), st.booleans())))
def test_every_goal_is_sent_a_bounded_number_of_times(on_lost: str, events: List[tuple]) -> None:
    resending = Resending(on_lost)
    for lost, there, cancelled in events:
        if cancelled:
            resending.cancel()
        if resending.ended(lost) is not None:
            break
        assert on_lost == RESEND and lost and not resending.cancelled
        if resending.executor(there) is not None:
            break
    assert resending.sent_again <= (RESENDS if on_lost == RESEND else 0)


# --- the request around it ------------------------------------------------------------------------------


class Sent:
    """A goal at an action server of the test's."""

    def __init__(self, number: int, on_done: Callable[[Any], None]) -> None:
        self.id = f"goal-{number}"
        self.status = GoalStatus.PENDING
        self.text = ""
        self.result = ExecuteResult()
        self.feedback = None
        self.seen = True
        self.active = False
        self.cancelled = threading.Event()
        self._on_done = on_done

    def cancel(self) -> None:
        self.cancelled.set()

    def end(self, status: int, text: str = "", **result: Any) -> None:
        self.status, self.text, self.result = status, text, ExecuteResult(**result)
        self._on_done(self)


class Client:
    """An action client whose server lives while `there` is set."""

    name = "/merlin/execute"
    heard = True

    def __init__(self) -> None:
        self.there = threading.Event()
        self.there.set()
        self.sent: List[Sent] = []
        self.how: List[Dict[str, Any]] = []
        self.changed = threading.Condition()

    def send(self, goal: Any, on_done: Callable, on_feedback: Optional[Callable], **how: Any) -> Sent:
        with self.changed:
            self.how.append(how)
            self.sent.append(Sent(len(self.sent), on_done))
            self.changed.notify_all()
            return self.sent[-1]

    def wait_for_server(self, timeout: float, unless: Callable[[], bool]) -> bool:
        return self.there.is_set() and not unless()

    def wait_sent(self, count: int) -> Sent:
        with self.changed:
            assert self.changed.wait_for(lambda: len(self.sent) >= count, LONG)
            return self.sent[count - 1]


class Statuses:
    """The subscribers of the Executor's status."""

    def __init__(self) -> None:
        self.callbacks: List[Callable] = []
        self.subscribed = threading.Event()

    def __call__(self, topic: str, message_class: type, callback: Callable, **_: Any) -> SimpleNamespace:
        assert topic == "/merlin/execute/status"
        self.callbacks.append(callback)
        self.subscribed.set()
        return SimpleNamespace(unregister=lambda: None)

    def publish(self, *goals: str) -> None:
        """A status that tells of some goals that have ended comes to the subscriber that waits for one."""
        assert self.subscribed.wait(LONG)
        if not goals:
            self.subscribed.clear()
        self.tell(*(GoalStatus(goal_id=GoalID(id=goal), status=GoalStatus.PREEMPTED) for goal in goals))

    def tell(self, *listed: GoalStatus) -> None:
        self.callbacks[-1](GoalStatusArray(status_list=listed))


@pytest.fixture
def client() -> Client:
    return Client()


@pytest.fixture
def statuses(monkeypatch: pytest.MonkeyPatch) -> Statuses:
    made = Statuses()
    monkeypatch.setattr(rospy, "Subscriber", made)
    master = SimpleNamespace(getPid=lambda: 1, master_uri="http://here")
    monkeypatch.setattr(late_topics, "bounded_master", lambda *_: master)
    monkeypatch.setattr(rospy, "logwarn", lambda text: None)
    return made


def request(client: Client, on_lost: str, done: Optional[List[ExecutorRequest]] = None) -> ExecutorRequest:
    reported = done.append if done is not None else None
    return ExecutorRequest(client, ExecuteGoal(), reported, on_lost=on_lost)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("active", "status", "text", "begun"),
    [
        (True, GoalStatus.LOST, "the process is gone", True),
        (False, GoalStatus.LOST, "the process is gone", False),
        (False, GoalStatus.ABORTED, "the executor failed: KeyError", True),
        (False, GoalStatus.ABORTED, "the action server shuts down", False),  # it may have waited
        (False, GoalStatus.REJECTED, "no object 'x'", False),
        (False, GoalStatus.PREEMPTED, "the executor shuts down", True),
        (False, GoalStatus.RECALLED, "the executor shuts down", False),
    ],
)
def test_a_request_that_has_ended_says_whether_it_had_begun(
    client: Client, active: bool, status: int, text: str, begun: bool
) -> None:
    sent = request(client, END)
    client.sent[0].active = active
    client.sent[0].end(status, text, reason="" if "server" in text else text)
    assert sent.done and sent.begun is begun


def test_one_that_was_lost_while_it_ran_has_begun_also_when_it_is_sent_again_in_vain(
    client: Client, statuses: Statuses
) -> None:
    done: queue.Queue[ExecutorRequest] = queue.Queue()
    sent = ExecutorRequest(client, ExecuteGoal(), done.put, on_lost=RESEND)  # type: ignore[arg-type]
    client.sent[0].active = True
    client.sent[0].end(GoalStatus.LOST, "the process is gone")
    statuses.publish()
    client.wait_sent(2)
    client.there.clear()
    client.sent[1].end(GoalStatus.LOST, "the process is gone")
    statuses.publish()
    assert done.get(timeout=LONG) is sent and sent.begun
    assert sent.result.outcome == ExecuteResult.INTERNAL


def test_a_request_ends_with_the_reason_of_the_loss(client: Client) -> None:
    done: List[ExecutorRequest] = []
    sent = request(client, END, done)
    client.sent[0].end(GoalStatus.LOST, "the action server /merlin/execute is gone")
    assert done == [sent] and sent.done
    assert sent.result.outcome == ExecuteResult.INTERNAL
    assert sent.result.reason == "the action server /merlin/execute is gone"


def test_a_request_survives_its_executor(client: Client, statuses: Statuses) -> None:
    done: List[ExecutorRequest] = []
    sent = request(client, RESEND, done)
    client.sent[0].end(GoalStatus.LOST, "gone")
    assert not sent.done
    statuses.publish()
    second = client.wait_sent(2)
    assert not done
    second.end(GoalStatus.SUCCEEDED, reason="done")
    assert sent.result.reason == "done" and done == [sent]
    assert sent.id == "goal-1"  # the request may know it a moment after the server does


def test_a_request_that_met_a_dying_executor_goes_to_the_next(client: Client, statuses: Statuses) -> None:
    sent = request(client, END)
    client.sent[0].seen = False
    client.sent[0].end(GoalStatus.LOST, "the action server /merlin/execute never acknowledged the goal")
    statuses.publish()
    client.wait_sent(2).end(GoalStatus.SUCCEEDED, reason="done")
    assert sent.result.reason == "done"


def test_a_request_to_an_executor_that_was_never_there_ends(client: Client) -> None:
    client.heard = False
    sent = request(client, END)
    client.sent[0].seen = False
    client.sent[0].end(GoalStatus.LOST, "the action server /merlin/execute has been silent for 3.0 s")
    assert sent.done and len(client.sent) == 1


@pytest.mark.parametrize(
    ("status", "text", "reason"),
    [
        (GoalStatus.PREEMPTED, "", "the executor shuts down"),
        (GoalStatus.ABORTED, "", "the executor shuts down; the planner does not answer"),
        (GoalStatus.ABORTED, "the action server shuts down", ""),
    ],
)
def test_an_executor_that_goes_down_in_order_is_lost_too(
    client: Client, statuses: Statuses, status: int, text: str, reason: str
) -> None:
    request(client, RESEND)
    client.sent[0].end(status, text, outcome=ExecuteResult.CANCELLED, reason=reason)
    statuses.publish()
    client.wait_sent(2)


def lost_through_silence() -> str:
    """What an Executor answers a client whose lease has run out."""
    leases = LeaseBook()
    leases.arrive(f"1{LEASED}", "/mission")
    leases.renew("/mission", "life", [f"1{LEASED}"], ())
    (lost,) = leases.pass_time(LOSE_AFTER + 0.1)
    agenda: Agenda[Ticket] = Agenda()
    ticket = Ticket(1, goes_on=False)
    agenda.receive(ticket)
    agenda.begin()
    agenda.client(ticket, agenda_rules.Client.GONE, lost.reason)
    (answer,) = agenda.ended(Verdict(Outcome.CANCELLED))
    assert isinstance(answer, AgendaAnswer)
    return answer.verdict.reason


def test_a_goal_that_the_silence_of_its_own_mission_ended_is_sent_again(
    client: Client, statuses: Statuses
) -> None:
    sent = request(client, RESEND)
    reason = lost_through_silence()
    client.sent[0].end(GoalStatus.PREEMPTED, outcome=ExecuteResult.CANCELLED, reason=reason)
    statuses.publish(sent.id)  # the Executor lives, and still tells of the goal that it has ended
    client.wait_sent(2).end(GoalStatus.SUCCEEDED, reason="done")
    assert sent.result.reason == "done"


@pytest.mark.parametrize("by_operator", [True, False])
def test_the_silence_of_a_mission_is_no_operator_who_cancels(client: Client, by_operator: bool) -> None:
    sent = request(client, END)
    reason = StopKind.CANCELLED.value if by_operator else lost_through_silence()
    client.sent[0].end(GoalStatus.PREEMPTED, outcome=ExecuteResult.CANCELLED, reason=reason)
    assert sent.result.reason == reason
    assert sent.taken_back is by_operator


def test_an_executor_that_goes_down_does_not_get_the_goal_again(client: Client, statuses: Statuses) -> None:
    sent = request(client, RESEND)
    for number in range(1, RESENDS + 1):
        client.wait_sent(number).end(
            GoalStatus.PREEMPTED, outcome=ExecuteResult.CANCELLED, reason="the executor shuts down"
        )
        statuses.publish(sent.id)  # of the one that goes down
        assert len(client.sent) == number
        statuses.publish()
    client.wait_sent(RESENDS + 1).end(GoalStatus.SUCCEEDED, reason="done")
    assert sent.result.reason == "done"


def test_one_that_survives_is_found_again_by_its_id(client: Client, statuses: Statuses) -> None:
    sent = ExecutorRequest(client, ExecuteGoal(survives=True))  # type: ignore[arg-type]
    first = client.sent[0]
    first.end(GoalStatus.PREEMPTED, outcome=ExecuteResult.CANCELLED, reason="the executor shuts down")
    assert statuses.subscribed.wait(LONG)
    # The next Executor has it already.
    statuses.tell(GoalStatus(goal_id=GoalID(id=first.id), status=GoalStatus.ACTIVE))
    client.wait_sent(2).end(GoalStatus.SUCCEEDED, reason="done")
    assert client.how == [{"lasting": True, "again": ""}, {"lasting": True, "again": first.id}]
    assert sent.wait(LONG) and sent.result is not None and sent.result.reason == "done"


def test_one_that_survives_is_left_and_not_cancelled(client: Client) -> None:
    done: List[ExecutorRequest] = []
    sent = ExecutorRequest(client, ExecuteGoal(survives=True), done.append)  # type: ignore[arg-type]
    sent.leave()
    assert done == [sent] and sent.result.reason == GOES_ON and not sent.taken_back
    client.sent[0].end(GoalStatus.SUCCEEDED, reason="done")
    assert done == [sent] and not client.sent[0].cancelled.is_set()


def test_any_other_request_that_its_client_leaves_is_cancelled(client: Client) -> None:
    request(client, END).leave()
    assert client.sent[0].cancelled.is_set()


def test_the_second_loss_waits_for_the_executor_too(client: Client, statuses: Statuses) -> None:
    request(client, RESEND)
    for number in (1, 2):
        client.wait_sent(number).end(GoalStatus.LOST, "gone")
        assert statuses.subscribed.wait(LONG), "it did not look whether the executor is back"
        statuses.publish()
    client.wait_sent(3)


def test_a_cancel_ends_the_wait_for_the_executor(client: Client, statuses: Statuses) -> None:
    sent = request(client, RESEND)
    client.sent[0].end(GoalStatus.LOST, "gone")
    sent.cancel()
    assert sent.wait(LONG)
    assert sent.result.outcome == ExecuteResult.CANCELLED
    assert sent.result.reason == "cancelled while the executor was gone"
    assert len(client.sent) == 1


def test_a_cancel_of_one_that_survives_reaches_the_next_executor(client: Client, statuses: Statuses) -> None:
    sent = ExecutorRequest(client, ExecuteGoal(survives=True))  # type: ignore[arg-type]
    client.sent[0].end(GoalStatus.LOST, "gone")
    sent.cancel()
    assert not sent.done, "the next executor would carry it out all the same"
    statuses.publish()
    second = client.wait_sent(2)
    assert second.cancelled.wait(LONG) and client.how[1]["again"] == "goal-0"
    second.end(GoalStatus.PREEMPTED, outcome=ExecuteResult.CANCELLED, reason="cancelled by its client")
    assert sent.wait(LONG) and sent.result.outcome == ExecuteResult.CANCELLED and not sent.taken_back


def test_one_that_was_being_cancelled_when_the_executor_died_is_cancelled_again(
    client: Client, statuses: Statuses
) -> None:
    sent = ExecutorRequest(client, ExecuteGoal(survives=True))  # type: ignore[arg-type]
    sent.cancel()
    client.sent[0].end(GoalStatus.LOST, "gone")
    statuses.publish()
    assert client.wait_sent(2).cancelled.wait(LONG)


def test_a_cancel_that_no_executor_has_heard_is_not_said_to_have_worked(
    client: Client, statuses: Statuses, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(resending_rules, "RETURN_WAIT", 0.01)
    client.there.clear()
    sent = ExecutorRequest(client, ExecuteGoal(survives=True))  # type: ignore[arg-type]
    sent.cancel()
    client.sent[0].end(GoalStatus.LOST, "gone")
    assert sent.wait(LONG) and sent.result.outcome == ExecuteResult.INTERNAL
    assert "it may go on when the executor returns" in sent.result.reason


def test_one_that_its_client_has_left_is_not_sent_again(client: Client, statuses: Statuses) -> None:
    done: List[ExecutorRequest] = []
    sent = ExecutorRequest(client, ExecuteGoal(survives=True), done.append)  # type: ignore[arg-type]
    client.sent[0].end(GoalStatus.LOST, "gone")
    sent.leave()
    assert sent.wait(LONG) and sent.result.reason == GOES_ON
    assert done == [sent] and len(client.sent) == 1


def test_an_executor_that_does_not_return_ends_the_request(
    client: Client, statuses: Statuses, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(resending_rules, "RETURN_WAIT", 0.01)
    client.there.clear()
    sent = request(client, RESEND)
    client.sent[0].end(GoalStatus.LOST, "gone")
    assert sent.wait(LONG)
    assert sent.result.outcome == ExecuteResult.INTERNAL
    assert "did not return within" in sent.result.reason


def test_an_answer_without_a_result_still_has_a_reason(client: Client) -> None:
    for status, outcome in (
        (GoalStatus.RECALLED, ExecuteResult.CANCELLED),
        (GoalStatus.ABORTED, ExecuteResult.INTERNAL),
    ):
        sent = request(client, END)
        client.sent[-1].end(status, "the action server shuts down")
        assert (sent.result.outcome, sent.result.reason) == (outcome, "the action server shuts down")

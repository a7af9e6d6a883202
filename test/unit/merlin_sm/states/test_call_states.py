# SPDX-License-Identifier: Apache-2.0
"""States that call a service or wait for a topic: every wait has an end, and the end says why."""

import re
import threading
from types import SimpleNamespace
from typing import Any, Callable, List

import pytest
from merlin_msgs.msg import ListenAction, ListenGoal, RecognizeAction, RecognizeGoal
from std_msgs.msg import Bool
from std_srvs.srv import SetBool, SetBoolRequest, SetBoolResponse

from merlin_ros.call_scope import CallScope, current_scope
from merlin_ros.master.master_link import MasterSilent
from merlin_ros.service_proxy import ServiceError
from merlin_sm.merlin_sm import MerlinSM
from merlin_sm.states import action_state, ros_calls
from merlin_sm.states.action_state import ActionState
from merlin_sm.states.merlin_state import ABORTED, PREEMPTED, SUCCEEDED, GivenUp
from merlin_sm.states.ros_calls import ServiceCallState, TopicState
from merlin_test import LONG
from smach import InvalidTransitionError, UserData


class Service:
    """Takes the place of a proxy; its answer comes when it is let go on."""

    name = "/switch"

    def __init__(self) -> None:
        self.there = True
        self.on_wait: Callable[[], None] = lambda: None
        self.scopes: List[CallScope] = []
        self.requests: List[Any] = []
        self.answer: Any = "answer"
        self.called = threading.Event()
        self.goes_on = threading.Event()
        self.goes_on.set()

    def wait(self, timeout: float) -> bool:
        self.on_wait()
        return self.there

    def __call__(self, *request: Any) -> Any:
        self.requests.append(request)
        self.scopes.append(current_scope())
        self.called.set()
        assert self.goes_on.wait(LONG)
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer


@pytest.fixture
def service(monkeypatch: pytest.MonkeyPatch) -> Service:
    made = Service()
    monkeypatch.setattr(ros_calls, "ServiceProxy", lambda *_: made)
    return made


def call(**options: Any) -> ServiceCallState:
    return ServiceCallState("switch", SetBool, **options)


def test_a_service_gets_the_request_and_its_answer_chooses_the_outcome(service: Service) -> None:
    data = UserData()
    data.on = True
    kept: List[Any] = []

    def keep(userdata: Any, answer: Any) -> str:
        kept.append(answer)
        return "off"

    state = call(
        request=lambda userdata: SetBoolRequest(userdata.on),
        on_response=keep,
        outcomes=["off"],
        input_keys=["on"],
    )
    assert state.execute(data) == "off"
    assert (service.requests, kept) == ([(SetBoolRequest(True),)], ["answer"])
    assert call().execute(data) == SUCCEEDED
    assert service.requests[1] == ()


@pytest.mark.parametrize(
    ("message", "reason"),
    [("no air pressure", "/switch did not succeed: no air pressure"), ("", "/switch did not succeed")],
)
def test_a_service_that_did_not_succeed_fails_unless_a_function_judges_it(
    service: Service, message: str, reason: str
) -> None:
    service.answer = SetBoolResponse(False, message)
    state = call()
    assert (state.execute(UserData()), state.reason) == (ABORTED, reason)
    assert call(on_response=lambda *_: None).execute(UserData()) == SUCCEEDED
    service.answer = SetBoolResponse(True, message)
    assert state.execute(UserData()) == SUCCEEDED


def test_an_answer_to_the_response_that_is_not_an_outcome_is_no_success(service: Service) -> None:
    machine = MerlinSM([SUCCEEDED, ABORTED, PREEMPTED])
    with machine:
        machine.add("CALL", call(on_response=lambda *_: False))
    with pytest.raises(InvalidTransitionError, match="CALL.*ended with False"):
        machine.execute()


def test_a_service_that_does_not_come_or_answer_is_named(service: Service) -> None:
    service.answer = ServiceError("/switch does not answer")
    state = call(wait=0.5)
    assert state.execute(UserData()) == ABORTED and state.reason == "/switch does not answer"
    service.there = False
    assert state.execute(UserData()) == ABORTED and state.reason == "no service /switch within 0.5 s"


def test_an_error_of_the_call_that_is_no_answer_is_raised(service: Service) -> None:
    service.answer = TypeError("not a SetBoolRequest")
    with pytest.raises(TypeError, match="not a SetBoolRequest"):
        call(request=lambda _: SetBoolRequest()).execute(UserData())


@pytest.mark.parametrize(
    ("made", "reason"),
    [
        (None, "the request is None; it has to be a SetBoolRequest"),
        (3, "the request is 3; it has to be a SetBoolRequest"),
        (SetBoolRequest(data="yes"), "the request cannot be sent: "),
    ],
)
def test_what_a_function_makes_has_to_be_a_request(service: Service, made: Any, reason: str) -> None:
    state = call(request=lambda _: made)
    assert state.execute(UserData()) == ABORTED
    assert state.reason.startswith(reason) and service.requests == []


ERRORS = [ValueError("no air"), GivenUp("no air")]


def fails(error: Exception) -> Callable[..., Any]:
    def function(*_: Any) -> Any:
        raise error

    return function


@pytest.mark.parametrize("error", ERRORS)
def test_a_request_that_cannot_be_made_aborts_with_its_text(service: Service, error: Exception) -> None:
    state = call(request=fails(error))
    assert state.execute(UserData()) == ABORTED
    assert (state.reason, state.given_up) == ("no air", isinstance(error, GivenUp))
    assert service.requests == []


@pytest.mark.parametrize("error", ERRORS)
def test_what_came_and_cannot_be_used_aborts_with_the_text_of_its_function(
    service: Service, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    door(monkeypatch, Bool(True))
    for state in (call(on_response=fails(error)), TopicState("door", Bool, fails(error))):
        assert state.execute(UserData()) == ABORTED
        assert (state.reason, state.given_up) == ("no air", isinstance(error, GivenUp))


def test_a_preempt_does_not_wait_for_the_answer(service: Service) -> None:
    service.goes_on.clear()
    state = call()
    outcomes: List[str] = []
    run = threading.Thread(target=lambda: outcomes.append(state.execute(UserData())), daemon=True)
    run.start()
    assert service.called.wait(LONG)
    state.request_preempt()
    run.join(LONG)
    assert outcomes == [PREEMPTED]
    # The call under way is given up: the next run does not wait for it.
    wake = threading.Event()
    with service.scopes[0].calling(wake.set):
        assert service.scopes[0].ended or wake.wait(LONG)
    service.goes_on.set()


def test_a_service_that_comes_after_the_preempt_is_not_called(service: Service) -> None:
    state = call()
    waits, comes = threading.Event(), threading.Event()
    callers: List[threading.Thread] = []
    service.on_wait = lambda: (callers.append(threading.current_thread()), waits.set(), comes.wait(LONG))
    outcomes: List[str] = []
    run = threading.Thread(target=lambda: outcomes.append(state.execute(UserData())), daemon=True)
    run.start()
    assert waits.wait(LONG)
    state.request_preempt()
    run.join(LONG)
    comes.set()
    callers[0].join(LONG)
    assert outcomes == [PREEMPTED] and service.requests == []


class Topic:
    """The subscribers of a topic; the messages come as soon as there is one."""

    def __init__(self, *messages: Any) -> None:
        self.messages = messages
        self.on_subscribe: Callable[[], None] = lambda: None
        self.unregistered = 0

    def __call__(self, name: str, message_class: type, callback: Callable[[Any], None]) -> Any:
        for message in self.messages:
            callback(message)
        self.on_subscribe()
        return SimpleNamespace(unregister=self._unregister)

    def _unregister(self) -> None:
        self.unregistered += 1


def door(monkeypatch: pytest.MonkeyPatch, *messages: Any) -> Topic:
    topic = Topic(*messages)
    monkeypatch.setattr(ros_calls, "subscribe", topic)
    return topic


def test_a_state_waits_for_the_message_that_fits(monkeypatch: pytest.MonkeyPatch) -> None:
    topic = door(monkeypatch, Bool(False), Bool(True))
    data = UserData()

    def accept(userdata: Any, message: Bool) -> bool:
        userdata.last = message.data
        return bool(message.data)

    state = TopicState("door", Bool, accept, timeout=LONG, output_keys=["last"])
    assert state.execute(data) == SUCCEEDED
    assert data.last is True and topic.unregistered == 1


def test_a_message_may_choose_the_outcome(monkeypatch: pytest.MonkeyPatch) -> None:
    door(monkeypatch, Bool(True))
    assert TopicState("door", Bool, lambda *_: "open", outcomes=["open"]).execute(UserData()) == "open"


def test_what_comes_behind_the_accepted_message_is_not_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    door(monkeypatch, Bool(True), Bool(False))
    data = UserData()

    def accept(userdata: UserData, message: Bool) -> str:
        userdata.open = message.data
        return "open" if message.data else "closed"

    state = TopicState("door", Bool, accept, outcomes=["open", "closed"], output_keys=["open"])
    assert state.execute(data) == "open" and data.open is True


@pytest.mark.parametrize("timeout", [0.01, 0.0])
def test_without_a_message_the_topic_and_the_time_are_named(
    monkeypatch: pytest.MonkeyPatch, timeout: float
) -> None:
    topic = door(monkeypatch, Bool(False))
    state = TopicState("door", Bool, lambda _, message: message.data, timeout=timeout)
    assert state.execute(UserData()) == ABORTED
    assert state.reason == f"nothing fitting arrived on /door within {timeout:g} s"
    assert topic.unregistered == 1


def test_a_preempt_ends_the_wait_for_a_message(monkeypatch: pytest.MonkeyPatch) -> None:
    topic = door(monkeypatch)
    state = TopicState("door", Bool)
    topic.on_subscribe = state.request_preempt
    assert state.execute(UserData()) == PREEMPTED and topic.unregistered == 1


def test_an_error_of_the_users_function_is_raised(monkeypatch: pytest.MonkeyPatch) -> None:
    topic = door(monkeypatch, Bool(True))
    with pytest.raises(ZeroDivisionError):
        TopicState("door", Bool, lambda *_: 1 / 0).execute(UserData())
    assert topic.unregistered == 1


def test_a_silent_master_aborts(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any) -> Any:
        raise MasterSilent("the ROS master does not answer")

    monkeypatch.setattr(ros_calls, "subscribe", refuse)
    state = TopicState("door", Bool)
    assert state.execute(UserData()) == ABORTED and state.reason == "the ROS master does not answer"


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: ServiceCallState(7, SetBool), "7 cannot be the name of a service"),
        (lambda: ServiceCallState("", SetBool), "'' cannot be the name of a service"),
        (lambda: ServiceCallState("s", SetBoolRequest), "is not the class of a service"),
        (lambda: ServiceCallState("s", SetBool, 3), "the request is 3; it has to be a SetBoolRequest"),
        (lambda: ServiceCallState("s", SetBool, wait=float("nan")), "wait is nan"),
        (lambda: ServiceCallState("s", SetBool, timeout=-1), "timeout is -1"),
        (lambda: TopicState("a topic", Bool), "'a topic' cannot be the name of a topic"),
        (lambda: TopicState("t", Bool()), "is not the class of a message"),
        (lambda: TopicState("t", Bool, timeout="3"), "timeout is '3'"),
        (lambda: ActionState(7, ListenAction, ListenGoal()), "7 cannot be the name of an action"),
        (
            lambda: ActionState("an act", ListenAction, ListenGoal()),
            "'an act' cannot be the name of an action",
        ),
        (lambda: ActionState("", ListenAction, ListenGoal()), "'' cannot be the name of an action"),
        (lambda: ActionState("a", ListenGoal, ListenGoal()), "is not the class of an action"),
        (lambda: ActionState("a", "ListenAction", lambda _: ListenGoal()), "is not the class of an action"),
        (lambda: ActionState("a", ListenAction, 7), "the goal is 7; it has to be a ListenGoal"),
        (lambda: ActionState("a", ListenAction, ListenGoal(timeout="x")), "the goal cannot be sent: "),
        (
            lambda: ActionState("a", ListenAction, ListenGoal(), server_wait=float("nan")),
            "server_wait is nan",
        ),
        (lambda: ActionState("a", ListenAction, ListenGoal(), cancel_limit=-1), "cancel_limit is -1"),
    ],
)
def test_what_can_never_be_called_is_refused_when_the_state_is_made(
    make: Callable[[], Any], said: str
) -> None:
    with pytest.raises(ValueError, match=re.escape(said)):
        make()


@pytest.fixture
def no_servers(monkeypatch: pytest.MonkeyPatch) -> None:
    """A client that is used for a goal fails the test."""
    monkeypatch.setattr(
        action_state,
        "ActionClient",
        lambda name, spec: SimpleNamespace(name=name, action_spec=spec, shutdown=lambda: None),
    )
    monkeypatch.setattr(action_state, "shared_guard_watch", lambda: None)


@pytest.mark.usefixtures("no_servers")
@pytest.mark.parametrize(
    ("made", "reason"),
    [
        (None, "the goal is None; it has to be a ListenGoal"),
        (SetBoolRequest(), "the goal is a SetBoolRequest; it has to be a ListenGoal"),
        (ListenGoal(timeout="x"), "the goal cannot be sent: "),
    ],
)
def test_what_a_function_makes_has_to_be_a_goal(made: Any, reason: str) -> None:
    state = ActionState("centrifuge", ListenAction, lambda _: made)
    assert state.execute(UserData()) == ABORTED
    assert state.reason.startswith(reason)


@pytest.mark.usefixtures("no_servers")
def test_two_states_that_take_an_action_for_different_types_are_refused() -> None:
    kept = ActionState("centrifuge", ListenAction, ListenGoal())
    assert kept.action == ActionState("centrifuge", ListenAction, ListenGoal()).action
    with pytest.raises(
        ValueError, match="/centrifuge is a ListenAction in one state and a RecognizeAction here"
    ):
        ActionState("centrifuge", RecognizeAction, RecognizeGoal())

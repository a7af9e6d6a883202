# SPDX-License-Identifier: Apache-2.0
"""States that call a service or wait for a topic."""

import threading
from io import BytesIO
from typing import Any, Callable, List, Optional, Sequence

import genpy
import rospy

from merlin_ros.call_scope import CallScope
from merlin_ros.deadline import Deadline
from merlin_ros.late_topics import subscribe
from merlin_ros.master.master_link import MasterSilent
from merlin_ros.parameters import is_name
from merlin_ros.service_proxy import ServiceError, ServiceProxy
from merlin_ros.work.threads import start_thread
from merlin_sm.states.merlin_state import FAILURES, PREEMPTED, SUCCEEDED, MerlinState
from merlin_sm.states.text_keys import check_keys


def check_name(kind: str, name: Any) -> None:
    """Judges the name of what a state calls.

    :param kind: what it is, for the text.
    :raises ValueError: when no action, service or topic can have it.
    """
    if not is_name(name):
        raise ValueError(f"{name!r} cannot be the name of {kind}: a text of letters, digits, _ and /")


def check_message(what: str, message: Any, kind: type) -> None:
    """Judges what a state sends.

    :param what: it is, for the text.
    :raises ValueError: when it has another type, or a field a wrong value.
    """
    if not isinstance(message, kind):
        # A message is printed in many lines.
        given = f"a {type(message).__name__}" if isinstance(message, genpy.Message) else repr(message)
        raise ValueError(f"the {what} is {given}; it has to be a {kind.__name__}")
    sent: Any = message
    try:
        sent.serialize(BytesIO())
    except (genpy.MessageException, AttributeError) as error:  # genpy judges no fields of fields
        raise ValueError(f"the {what} cannot be sent: {error}") from None


def check_times(**times: Any) -> None:
    """Judges limits of a state.

    :raises ValueError: for one that is not a number of seconds, 0 or more.
    """
    for name, seconds in times.items():
        if not (isinstance(seconds, (int, float)) and seconds >= 0.0):
            raise ValueError(f"{name} is {seconds!r}; it has to be a number of seconds, 0 or more")


def check_shares(**shares: Any) -> None:
    """Judges shares.

    :raises ValueError: for one that is not a number from 0 to 1.
    """
    for name, share in shares.items():
        if not (isinstance(share, (int, float)) and 0.0 <= share <= 1.0):
            raise ValueError(f"{name} is {share!r}; it has to be a number from 0 to 1")


def call_apart(
    state: MerlinState, name: str, calls: Callable[[Callable[[], bool]], Any], limit: Optional[float] = None
) -> List[Any]:
    """Runs what calls services in a thread of its own; a preempt of the state, or the limit, ends it.

    :param name: of what is called, for the thread.
    :param calls: a function of another one, which says whether the wait has ended.
    :param limit: s of running time; None: as long as it takes.
    :return: what `calls` returned or raised; empty when the wait ended before.
    """
    ended = threading.Event()
    scope = CallScope()
    answers: List[Any] = []

    def run() -> None:
        with scope:
            try:
                answers.append(calls(ended.is_set))
            except Exception as error:  # besides a ServiceError: a request of another type
                answers.append(error)
        ended.set()

    def end() -> None:
        ended.set()
        scope.end()

    start_thread(f"call of {name}", run)
    state.interruptible(end)
    if not Deadline(limit).wait_event(ended):
        end()
    state.interruptible(None)
    return answers


class ServiceCallState(MerlinState):
    """Calls a service.

    Without `on_response`, a response whose field `success` is false, as std_srvs/Trigger has one, aborts with
    its `message`.

    :param name: of the service.
    :param service_class: the generated service type.
    :param request: the request, or a function from userdata to it; raise ValueError to abort with its text,
        GivenUp when another try cannot help. None: the default request.
    :param on_response: called with userdata and the response; returns an outcome, or None for succeeded;
        raise ValueError to abort with its text, GivenUp when another try cannot help.
    :param outcomes: those that `on_response` may return.
    :param input_keys: userdata that `request` reads.
    :param output_keys: userdata that `on_response` sets.
    :param wait: s of wall time to wait for the service.
    :param timeout: s of wall time to wait for the answer; None: as long as it takes.
    """

    def __init__(
        self,
        name: str,
        service_class: type,
        request: Any = None,
        on_response: Optional[Callable[[Any, Any], Optional[str]]] = None,
        outcomes: Sequence[str] = (),
        input_keys: Sequence[str] = (),
        output_keys: Sequence[str] = (),
        wait: float = 5.0,
        timeout: Optional[float] = None,
    ) -> None:
        check_keys(request, input_keys, output_keys, "input_keys")
        check_keys(on_response, input_keys, output_keys, "input_keys", "response")
        check_name("a service", name)
        check_times(wait=wait, timeout=0.0 if timeout is None else timeout)
        kind = getattr(service_class, "_request_class", None)
        if kind is None:
            raise ValueError(f"{service_class!r} is not the class of a service, as std_srvs.srv.Trigger")
        if request is not None and not callable(request):
            check_message("request", request, kind)
        self._request_class = kind
        super().__init__(outcomes, input_keys, output_keys)
        self.service = name
        self._service_class = service_class
        self._request = request
        self._on_response = on_response
        self._wait = wait
        self._proxy = ServiceProxy(name, service_class, timeout)

    def run(self, userdata: Any) -> str:
        """Calls the service; a preempt ends the wait, and no request is sent after it."""
        try:
            request = self._request(userdata) if callable(self._request) else self._request
            if self._request is not None:
                check_message("request", request, self._request_class)
        except (ValueError, LookupError) as error:
            return self.fail_for(error)

        def call(ended: Callable[[], bool]) -> Any:
            if not self._proxy.wait(self._wait):
                raise ServiceError(f"no service {self._proxy.name} within {self._wait:g} s")
            if ended():  # preempted: what it was to ask for is no longer wanted
                raise ServiceError(f"{self._proxy.name} was not called")
            return self._proxy() if request is None else self._proxy(request)

        answers = call_apart(self, self._proxy.name, call)
        if not answers or (self.preempt_requested() and isinstance(answers[0], ServiceError)):
            return PREEMPTED
        if isinstance(answers[0], ServiceError):
            return self.fail(str(answers[0]))
        if isinstance(answers[0], Exception):
            raise answers[0]
        if self._on_response is not None:
            return self.choose(self._on_response, userdata, answers[0])
        if getattr(answers[0], "success", True) is False:
            said = getattr(answers[0], "message", "")
            return self.fail(f"{self._proxy.name} did not succeed" + (f": {said}" if said else ""))
        return SUCCEEDED


class TopicState(MerlinState):
    """Waits for a message.

    :param topic: its name.
    :param message_class: its type.
    :param accept: a function from userdata and message to True (the message is the one), or an outcome;
        raise ValueError to abort with its text, GivenUp when another try cannot help.
    :param timeout: s of running time; None: as long as it takes.
    :param outcomes: those that `accept` may return.
    :param input_keys: userdata that `accept` reads.
    :param output_keys: userdata that `accept` sets.
    """

    def __init__(
        self,
        topic: str,
        message_class: type,
        accept: Callable[[Any, Any], Any] = lambda userdata, message: True,
        timeout: Optional[float] = None,
        outcomes: Sequence[str] = (),
        input_keys: Sequence[str] = (),
        output_keys: Sequence[str] = (),
    ) -> None:
        check_keys(accept, input_keys, output_keys, "input_keys", "message")
        check_name("a topic", topic)
        check_times(timeout=0.0 if timeout is None else timeout)
        if not (isinstance(message_class, type) and issubclass(message_class, genpy.Message)):
            raise ValueError(f"{message_class!r} is not the class of a message, as std_msgs.msg.Bool")
        super().__init__(outcomes, input_keys, output_keys)
        self._topic = topic
        self._message_class = message_class
        self._accept = accept
        self._timeout = timeout

    def run(self, userdata: Any) -> str:
        """Subscribes until a message is accepted."""
        ended = threading.Event()
        accepted: List[Any] = []
        one_by_one = threading.Lock()  # each publisher of the topic has a thread here

        def receive(message: Any) -> None:
            with one_by_one:
                if ended.is_set():  # userdata is what the accepted message has made of it
                    return
                try:
                    answer = self._accept(userdata, message)
                except Exception as error:  # rospy would log it, and the state would wait on
                    answer = error
                if answer:
                    accepted.append(answer)
                    ended.set()

        try:
            subscriber = subscribe(self._topic, self._message_class, receive)
        except MasterSilent as error:
            return self.fail(str(error))
        self.interruptible(ended.set)
        Deadline(self._timeout).wait_event(ended)
        ended.set()
        self.interruptible(None)
        subscriber.unregister()
        if accepted and isinstance(accepted[0], FAILURES):
            return self.fail_for(accepted[0])
        if accepted and isinstance(accepted[0], Exception):
            raise accepted[0]
        if accepted:
            return str(accepted[0]) if isinstance(accepted[0], str) else SUCCEEDED
        if self.preempt_requested():
            return PREEMPTED
        topic = rospy.resolve_name(self._topic)
        limit = "before the node ended" if self._timeout is None else f"within {self._timeout:g} s"
        return self.fail(f"nothing fitting arrived on {topic} {limit}")

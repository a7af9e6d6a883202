# SPDX-License-Identifier: Apache-2.0
"""The state that calls a service."""

import contextlib
import socket
import threading
import traceback
import xmlrpc.client
from typing import Any, Callable, Iterable, Mapping, Optional, Type

import rosgraph.network
import rospy
from rospy.impl.validators import ParameterInvalid

import smach
from smach.state import names
from smach_ros.user_callback import UserCallback, check_slots, fill
from smach_ros.waiting import Duration, WallDeadline, wait
from smach_ros.waiting_state import WaitingState

ASK_MASTER = 0.1  # s between questions for a service that does not exist yet; there is no event for it
MASTER_HANGS = 1.0  # s of wall time after which a question without an answer counts as "not offered"


class ServiceState(WaitingState):
    """Calls a service and ends with its response.

    Outcomes: ``succeeded``, ``aborted``, ``preempted`` and those of ``response_cb`` and ``outcomes``.

    :param service_name: relative names and remapping as usual.
    :param service_spec: the generated service class.
    :param request: the request, or what it starts from.
    :param request_cb: ``request_cb(ud, request, *args, **kwargs)`` edits the request or returns another.
    :param request_key: userdata key that holds the request.
    :param request_slots: fields of the request that are set from userdata keys of the same names.
    :param response_cb: ``response_cb(ud, response, *args, **kwargs)`` may return the outcome.
    :param response_key: userdata key that gets the response.
    :param response_slots: fields of the response that userdata keys of the same names get.
    :param call_timeout: wall time for the answer, then ``aborted``; None: as long as it takes.
    :param server_wait_timeout: wall time to wait for the service, likewise.
    """

    def __init__(
        self,
        service_name: str,
        service_spec: Type[Any],
        request: Any = None,
        request_cb: Optional[Callable[..., Any]] = None,
        request_cb_args: Iterable[Any] = (),
        request_cb_kwargs: Optional[Mapping[str, Any]] = None,
        request_key: Optional[str] = None,
        request_slots: Iterable[str] = (),
        response_cb: Optional[Callable[..., Any]] = None,
        response_cb_args: Iterable[Any] = (),
        response_cb_kwargs: Optional[Mapping[str, Any]] = None,
        response_key: Optional[str] = None,
        response_slots: Iterable[str] = (),
        input_keys: Iterable[str] = (),
        output_keys: Iterable[str] = (),
        outcomes: Iterable[str] = (),
        call_timeout: Optional[Duration] = None,
        server_wait_timeout: Optional[Duration] = None,
    ) -> None:
        super().__init__(outcomes=["succeeded", "aborted", "preempted"])
        input_keys, output_keys = names(input_keys, "input_keys"), names(output_keys, "output_keys")
        self._service_name = service_name
        self._what = f"Service {service_name}"
        self._service_spec = service_spec
        self._request_type = service_spec._request_class
        if request is not None and not isinstance(request, self._request_type):
            raise smach.InvalidStateError(
                f"{self._what}: the request must be a {self._request_type._type}, not {request!r}"
            )
        self._request = request
        self._request_key = request_key
        self._request_slots = check_slots(self._request_type, request_slots, "request_slots")
        self._response_key = response_key
        self._response_slots = check_slots(service_spec._response_class, response_slots, "response_slots")
        self._call_timeout = call_timeout
        self._server_wait_timeout = server_wait_timeout
        self.register_outcomes(names(outcomes, "outcomes"))
        self.register_input_keys([*input_keys, *([request_key] if request_key else []), *self._request_slots])
        self.register_output_keys(
            [*output_keys, *([response_key] if response_key else []), *self._response_slots]
        )
        self._request_cb = UserCallback(
            request_cb, request_cb_args, request_cb_kwargs, self, input_keys, output_keys, "request_cb"
        )
        self._response_cb = UserCallback(
            response_cb, response_cb_args, response_cb_kwargs, self, input_keys, output_keys, "response_cb"
        )

    def _execute(self, ud: Any) -> str:
        if not self._wait_for_service():
            return self._not_called()
        try:
            request = fill(
                self._request_type,
                self._request,
                self._request_key,
                self._request_slots,
                self._request_cb,
                ud,
            )
        except Exception:
            self._report(f"no request could be made\n{traceback.format_exc()}")
            return "aborted"
        if self.preempt_requested():
            return self._not_called()
        proxy = _Proxy(self._service_name, self._service_spec)
        call = _Apart(f"call of {self._service_name}", lambda: proxy.call_once(request), self._changed)
        if not call.ends(WallDeadline(self._call_timeout), self.preempt_requested):
            proxy.give_up()
            if not self.preempt_requested() and not rospy.is_shutdown():
                self._report(f"no answer within {self._call_timeout} s")
            return self._not_called()
        if call.error is not None:
            self._report(f"the call failed: {call.error}")
            return "aborted"
        return self._outcome(ud, call.answer)

    def _not_called(self) -> str:
        if self.preempt_requested() or rospy.is_shutdown():
            self.service_preempt()
            return "preempted"
        return "aborted"

    def _wait_for_service(self) -> bool:
        deadline = WallDeadline(self._server_wait_timeout)
        warned = False
        asked: Optional[_Apart] = None
        while not self.preempt_requested() and not rospy.is_shutdown():
            if asked is None or asked.done:
                asked = _Apart(
                    f"search for {self._service_name}", lambda: _offered(self._service_name), self._changed
                )
            if asked.ends(WallDeadline(MASTER_HANGS), self.preempt_requested):
                if asked.error is not None:
                    raise asked.error
                if asked.answer:
                    return True
            if deadline.remaining() <= 0.0:
                self._report(f"not offered within {self._server_wait_timeout} s (server_wait_timeout)")
                return False
            if not warned:
                rospy.logwarn(f"{self._what} is not offered yet; waiting")
                warned = True
            with self._changed:
                wait(self._changed, self.preempt_requested, WallDeadline(ASK_MASTER))
        return False

    def _outcome(self, ud: Any, response: Any) -> str:
        try:
            outcome = self._response_cb(ud, response)
            if outcome is not None and outcome not in self.get_registered_outcomes():
                self._report(
                    f"response_cb returned {outcome!r}, which is "
                    f"not one of the outcomes {list(self.get_registered_outcomes())}"
                )
                return "aborted"
            if self._response_key is not None:
                ud[self._response_key] = response
            for slot in self._response_slots:
                ud[slot] = getattr(response, slot)
        except Exception:
            self._report(f"the response cannot be used\n{traceback.format_exc()}")
            return "aborted"
        return "succeeded" if outcome is None else outcome


class _Proxy(rospy.ServiceProxy):
    """A call of it can be given up: while it waits for the answer, and before its request is sent.

    rospy keeps the transport of a persistent connection only, as soon as it is connected.
    """

    def __init__(self, name: str, spec: type) -> None:
        self._transport: Any = None
        self._given_up = False
        super().__init__(name, spec, persistent=True)

    def call_once(self, request: Any) -> Any:
        """Calls the service and closes the connection."""
        try:
            return self(request)
        finally:
            self.close()

    def give_up(self) -> None:
        """Breaks the connection, which ends the call; one that is being made when its server answers."""
        self._given_up = True
        # Closing a socket does not wake a thread that reads from it; shutting it down does.
        with contextlib.suppress(OSError, AttributeError):
            self._transport.socket.shutdown(socket.SHUT_RDWR)

    @property
    def transport(self) -> Any:
        """The connection; None: there is none yet."""
        return self._transport

    @transport.setter
    def transport(self, made: Any) -> None:
        self._transport = made
        if self._given_up:
            raise rospy.ServiceException("given up")


class _Apart:
    """Something that cannot be interrupted, in a thread of its own.

    :param name: of the thread.
    :param run: what it does.
    :param changed: guards the fields and is notified at the end.
    """

    def __init__(self, name: str, run: Callable[[], Any], changed: threading.Condition) -> None:
        self.done = False
        self.answer: Any = None
        self.error: Optional[Exception] = None
        self._run, self._changed = run, changed
        threading.Thread(target=self._live, name=name, daemon=True).start()

    def ends(self, deadline: WallDeadline, interrupted: Callable[[], bool]) -> bool:
        """Waits for its end; returns whether it has come."""
        with self._changed:
            wait(self._changed, lambda: self.done or interrupted(), deadline)
            return self.done

    def _live(self) -> None:
        try:
            self.answer = self._run()
        except Exception as error:  # reported by the state
            self.error = error
        with self._changed:
            self.done = True
            self._changed.notify_all()


def _offered(name: str) -> bool:
    """Whether the master knows the service and its server accepts connections."""
    try:
        service = rospy.resolve_name(name)
        code, _, uri = rospy.get_master().lookupService(service)
        if code != 1:
            return False
        with socket.create_connection(rospy.core.parse_rosrpc_uri(uri), timeout=1.0) as probe:
            # A server warns of a connection that closes without this.
            header = {"probe": "1", "md5sum": "*", "callerid": rospy.get_caller_id(), "service": service}
            rosgraph.network.write_ros_handshake_header(probe, header)
            return True
    except (OSError, xmlrpc.client.Error, ParameterInvalid):
        return False

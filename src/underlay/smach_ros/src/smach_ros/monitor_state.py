# SPDX-License-Identifier: Apache-2.0
"""The state that watches a topic."""

import collections
import enum
import threading
import traceback
from typing import Any, Callable, Deque, Iterable, Optional

import rospy

import smach
from smach.state import names
from smach_ros.user_callback import UserCallback
from smach_ros.waiting import Duration, RosDeadline, wait
from smach_ros.waiting_state import WaitingState

QUEUE = 10  # messages that wait for the condition; more wait in the connection


class MonitorState(WaitingState):
    """Checks each message of a topic until a check fails.

    Outcomes: ``valid``, ``invalid``, ``preempted`` and those that ``cond_cb`` declares.

    :param topic: relative names and remapping as usual.
    :param msg_type: the message class.
    :param cond_cb: ``cond_cb(ud, msg)``: what is false (or an exception) ends the state with ``invalid``; the
        name of an outcome ends it with that.
    :param max_checks: number of true checks after which it ends with ``valid``; -1: it continues.
    :param timeout: ROS time after which it ends: ``valid`` if all checks were true and there was one, else
        ``invalid``; None: no limit.
    """

    def __init__(
        self,
        topic: str,
        msg_type: type,
        cond_cb: Callable[..., Any],
        max_checks: int = -1,
        input_keys: Iterable[str] = (),
        output_keys: Iterable[str] = (),
        timeout: Optional[Duration] = None,
    ) -> None:
        input_keys, output_keys = names(input_keys, "input_keys"), names(output_keys, "output_keys")
        super().__init__(["valid", "invalid", "preempted"], input_keys, output_keys)
        self._topic = topic
        self._what = f"MonitorState of {topic}"
        self._msg_type = msg_type
        self._max_checks = max_checks
        self._timeout = timeout
        if cond_cb is None:
            raise smach.InvalidStateError(f"{self._what}: cond_cb is missing")
        self._cond_cb = UserCallback(cond_cb, (), {}, self, input_keys, output_keys, "cond_cb")

    def _execute(self, ud: Any) -> str:
        messages = _Queue(self._changed)
        # A connection takes time; not even that is worth it for a state that is to end.
        subscriber = None
        try:
            if self.preempt_requested():
                return self._preempted()
            subscriber = rospy.Subscriber(self._topic, self._msg_type, messages.put, tcp_nodelay=True)
            return self._monitor(ud, messages)
        finally:
            messages.close()
            if subscriber is not None:
                subscriber.unregister()

    def _preempted(self) -> str:
        self.service_preempt()
        return "preempted"

    def _monitor(self, ud: Any, messages: "_Queue") -> str:
        deadline = RosDeadline(self._timeout)
        checks = 0
        while True:
            with self._changed:
                wait(self._changed, lambda: bool(messages) or self.preempt_requested(), deadline)
                if self.preempt_requested() or rospy.is_shutdown():
                    return self._preempted()
                message = messages.get()
            if message is None:
                return "valid" if checks else "invalid"
            try:
                answer = self._cond_cb(ud, message)
            except Exception:
                self._report(f"cond_cb failed\n{traceback.format_exc()}")
                answer = False
            if self.preempt_requested():
                return self._preempted()
            # True is also the number 1; a check that is true is not an outcome.
            named = isinstance(answer, (str, enum.Enum, int)) and not isinstance(answer, bool)
            if named and answer in self.get_registered_outcomes():
                return answer
            if not answer:
                return "invalid"
            checks += 1
            if checks == self._max_checks:
                return "valid"


class _Queue:
    """Messages on their way from the subscriber's thread to the state's.

    :param changed: guards it.
    """

    def __init__(self, changed: threading.Condition) -> None:
        self._changed = changed
        self._messages: Deque[Any] = collections.deque()
        self._open = True

    def __bool__(self) -> bool:
        return bool(self._messages)

    def put(self, message: Any) -> None:
        """Adds a message; waits for room, as the connection then does."""
        with self._changed:
            while self._open and len(self._messages) >= QUEUE:
                self._changed.wait()
            if self._open:
                self._messages.append(message)
                self._changed.notify_all()

    def get(self) -> Any:
        """The oldest message, or None."""
        with self._changed:
            if not self._messages:
                return None
            self._changed.notify_all()
            return self._messages.popleft()

    def close(self) -> None:
        """Messages that come now are dropped."""
        with self._changed:
            self._open = False
            self._messages.clear()
            self._changed.notify_all()

# SPDX-License-Identifier: Apache-2.0
"""The state that calls an action."""

import traceback
import weakref
from typing import Any, Callable, Iterable, Mapping, Optional, Set

import rospy
from actionlib_msgs.msg import GoalStatus

import smach
from smach.state import names
from smach_ros.action_connection import ActionConnection, SentGoal
from smach_ros.user_callback import UserCallback, check_slots, fill
from smach_ros.waiting import Duration, RosDeadline, WallDeadline, wait
from smach_ros.waiting_state import ReportingState

MINUTE = rospy.Duration(60.0)
LOOK = 0.5  # s of wall time between looks whether the server still lives
STOP = 2.0  # s of wall time that goals get to end when the program ends


class SimpleActionState(ReportingState):
    """Sends a goal to an action server and ends with its result.

    When the program ends, behind all that it does at a shutdown of ROS, the goal is cancelled and gets `STOP`
    to end; no further one is sent.

    Outcomes: ``succeeded``, ``aborted``, ``preempted`` and those of ``result_cb`` and ``outcomes``.

    :param action_name: of the action; relative names and remapping as usual.
    :param action_spec: the generated ``...Action`` class.
    :param goal: the goal, or what it starts from.
    :param goal_key: userdata key that holds the goal.
    :param goal_slots: fields of the goal that are set from userdata keys of the same names.
    :param goal_cb: ``goal_cb(ud, goal, *args, **kwargs)`` edits the goal or returns another.
    :param result_key: userdata key that gets the result.
    :param result_slots: fields of the result that userdata keys of the same names get.
    :param result_cb: ``result_cb(ud, status, result, *args, **kwargs)`` may return the outcome; status is the
        actionlib status.
    :param exec_timeout: ROS time after which the goal is cancelled and the state ends with ``aborted``.
    :param preempt_timeout: ROS time that a cancelled goal gets to end; afterwards it is left alone.
    :param server_wait_timeout: wall time to wait for the server.
    """

    WAITING_FOR_SERVER = 0
    INACTIVE = 1
    ACTIVE = 2
    PREEMPTING = 3
    COMPLETED = 4

    _running: "Set[SimpleActionState]" = set()  # each change is one step of the interpreter
    _program_ends = False

    def __init__(
        self,
        action_name: str,
        action_spec: type,
        goal: Any = None,
        goal_key: Optional[str] = None,
        goal_slots: Iterable[str] = (),
        goal_cb: Optional[Callable[..., Any]] = None,
        goal_cb_args: Iterable[Any] = (),
        goal_cb_kwargs: Optional[Mapping[str, Any]] = None,
        result_key: Optional[str] = None,
        result_slots: Iterable[str] = (),
        result_cb: Optional[Callable[..., Any]] = None,
        result_cb_args: Iterable[Any] = (),
        result_cb_kwargs: Optional[Mapping[str, Any]] = None,
        input_keys: Iterable[str] = (),
        output_keys: Iterable[str] = (),
        outcomes: Iterable[str] = (),
        exec_timeout: Optional[Duration] = None,
        preempt_timeout: Optional[Duration] = MINUTE,
        server_wait_timeout: Optional[Duration] = MINUTE,
    ) -> None:
        super().__init__(outcomes=["succeeded", "aborted", "preempted"])
        input_keys, output_keys = names(input_keys, "input_keys"), names(output_keys, "output_keys")
        self._action_name = action_name
        self._what = f"Action {action_name}"
        self._action_spec = action_spec
        self._exec_timeout = exec_timeout
        self._preempt_timeout = preempt_timeout
        self._server_wait_timeout = server_wait_timeout
        action = action_spec()
        self._goal_type = type(action.action_goal.goal)
        if goal is not None and not isinstance(goal, self._goal_type):
            raise smach.InvalidStateError(
                f"Action {action_name}: the goal must be a {self._goal_type._type}, not {goal!r}"
            )
        self._goal = goal
        self._goal_key = goal_key
        self._goal_slots = check_slots(self._goal_type, goal_slots, "goal_slots")
        self._result_key = result_key
        self._result_slots = check_slots(type(action.action_result.result), result_slots, "result_slots")
        self.register_outcomes(names(outcomes, "outcomes"))
        self.register_input_keys([*input_keys, *([goal_key] if goal_key else []), *self._goal_slots])
        self.register_output_keys([*output_keys, *([result_key] if result_key else []), *self._result_slots])
        self._goal_cb = UserCallback(
            goal_cb, goal_cb_args, goal_cb_kwargs, self, input_keys, output_keys, "goal_cb"
        )
        self._result_cb = UserCallback(
            result_cb, result_cb_args, result_cb_kwargs, self, input_keys, output_keys, "result_cb"
        )
        self._status = self.INACTIVE
        self._sent: Optional[SentGoal] = None
        self._connection: Optional[ActionConnection] = None
        if rospy.core.is_initialized():
            self._connect()

    def _connect(self) -> ActionConnection:
        if self._connection is None:
            self._connection = ActionConnection.acquire(
                rospy.resolve_name(self._action_name), self._action_spec
            )
            # States come and go (machines built per goal); connections must go with them.
            weakref.finalize(self, self._connection.release_soon).atexit = False
        return self._connection

    def request_preempt(self) -> None:
        """Cancels the goal at once, or keeps it from being sent."""
        super().request_preempt()
        connection = self._connection
        if connection is None:
            return
        with connection.changed:
            if self._sent is not None and self._status == self.ACTIVE:
                self._status = self.PREEMPTING
                connection.cancel(self._sent)
            connection.changed.notify_all()

    def execute(self, ud: Any) -> str:
        """Sends the goal and waits for its end."""
        self._running.add(self)
        try:
            return super().execute(ud)
        finally:
            self._running.discard(self)
            self._status = self.INACTIVE

    @classmethod
    def _stop_all(cls) -> None:
        """Preempts all that run while a cancel can still be sent: a goal does not end with its program."""
        cls._program_ends = True
        deadline, running = WallDeadline(STOP), list(cls._running)
        for state in running:
            state.request_preempt()
        for state in running:
            changed = state._connect().changed
            with changed:
                wait(changed, state._is_done, deadline)

    def _is_done(self) -> bool:
        return self._sent is None or self._sent.done

    def _execute(self, ud: Any) -> str:
        if self._program_ends:
            self.request_preempt()
        connection = self._connect()
        self._status = self.WAITING_FOR_SERVER
        if not self._wait_for_server(connection):
            return self._preempted() if self.preempt_requested() or rospy.is_shutdown() else "aborted"
        try:
            goal = fill(self._goal_type, self._goal, self._goal_key, self._goal_slots, self._goal_cb, ud)
        except Exception:
            self._report(f"no goal could be made\n{traceback.format_exc()}")
            return "aborted"
        with connection.changed:
            # A preempting thread sets the flag first, then looks for a goal to cancel, under the same lock.
            if self.preempt_requested():
                return self._preempted()
            try:
                self._sent = sent = connection.send(goal)
            except Exception:
                self._report(f"the goal cannot be sent\n{traceback.format_exc()}")
                return "aborted"
            self._status = self.ACTIVE
        try:
            timed_out = self._wait_for_end(connection, sent)
        finally:
            with connection.changed:
                self._sent = None
                connection.forget(sent)
        self._status = self.COMPLETED
        if not sent.done:
            return self._preempted() if self.preempt_requested() or rospy.is_shutdown() else "aborted"
        return self._outcome(ud, sent, timed_out)

    def _preempted(self) -> str:
        self.service_preempt()
        return "preempted"

    def _wait_for_server(self, connection: ActionConnection) -> bool:
        deadline = WallDeadline(self._server_wait_timeout)
        with connection.changed:
            # rospy announces connections of publishers, but not those of subscribers.
            wait(connection.changed, lambda: self.preempt_requested() or connection.ready(), deadline, 0.02)
            if self.preempt_requested():
                return False
            if connection.ready():
                return True
        if not rospy.is_shutdown():
            self._report(f"no server within {self._server_wait_timeout} s (server_wait_timeout)")
        return False

    def _wait_for_end(self, connection: ActionConnection, sent: SentGoal) -> bool:
        """Waits until the goal has ended or its server is lost.

        :return: whether exec_timeout passed.
        """
        timed_out = False
        with connection.changed:
            deadline = RosDeadline(self._exec_timeout)
            wait(connection.changed, lambda: self._over(connection, sent, False), deadline, LOOK)
            if not sent.done and deadline.remaining() <= 0.0 and self._status == self.ACTIVE:
                self._report("cancelled after exec_timeout", rospy.logwarn)
                timed_out = True
                self._status = self.PREEMPTING
                connection.cancel(sent)
            if not sent.done and self._status == self.PREEMPTING:
                deadline = RosDeadline(self._preempt_timeout)
                if (
                    not wait(connection.changed, lambda: self._over(connection, sent, True), deadline, LOOK)
                    and not rospy.is_shutdown()
                ):
                    self._report(
                        "the server did not end the cancelled goal within preempt_timeout; leaving it"
                    )
            why = connection.why_lost(sent)
            if not sent.done and why and not rospy.is_shutdown():
                self._report(why)
                connection.cancel(sent)  # a server that hangs stops when it goes on
        return timed_out

    def _over(self, connection: ActionConnection, sent: SentGoal, preempting: bool) -> bool:
        if not sent.done:
            connection.repeat_cancel(sent)
            connection.settle(sent)
        return (
            sent.done
            or bool(connection.why_lost(sent))
            or (not preempting and self._status == self.PREEMPTING)
        )

    def _outcome(self, ud: Any, sent: SentGoal, timed_out: bool) -> str:
        result = sent.result
        outcome: Optional[str] = None
        try:
            outcome = self._result_cb(ud, sent.status, result)
            if outcome is not None and outcome not in self.get_registered_outcomes():
                self._report(
                    f"result_cb returned {outcome!r}, which is not "
                    f"one of the outcomes {list(self.get_registered_outcomes())}"
                )
                outcome = "aborted"
            if self._result_key is not None:
                ud[self._result_key] = result
            for slot in self._result_slots:
                ud[slot] = getattr(result, slot)
        except Exception:
            self._report(f"the result cannot be used\n{traceback.format_exc()}")
            outcome = "aborted"
        by_status = "aborted"
        if sent.status == GoalStatus.SUCCEEDED and not timed_out:
            by_status = "succeeded"
        elif sent.status in (GoalStatus.PREEMPTED, GoalStatus.RECALLED) and self.preempt_requested():
            # Otherwise the goal ended by itself, and the request continues to the states that follow.
            by_status = self._preempted()
        if by_status == "aborted" and outcome != "succeeded":
            late = "cancelled after exec_timeout, " if timed_out else ""
            ended = f"{late}the goal ended with status {sent.status}: {sent.text or 'no text'}"
            # What result_cb has named is expected.
            log = rospy.logwarn if outcome is None else rospy.logdebug
            self._report(ended, log)
        return outcome if outcome is not None else by_status


# Added among the hooks that run, it comes behind all of them: a preempt handler preempts the whole tree.
rospy.on_shutdown(lambda: rospy.on_shutdown(SimpleActionState._stop_all))

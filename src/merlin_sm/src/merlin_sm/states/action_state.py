# SPDX-License-Identifier: Apache-2.0
"""A state that runs a goal on an action server."""

import gc
import threading
import weakref
from typing import Any, Callable, Dict, Optional, Sequence

import rospy
from actionlib_msgs.msg import GoalStatus
from merlin_msgs.msg import GuardStatus

from merlin_ros.actions.action_client import ActionClient
from merlin_ros.actions.client_goal import ClientGoal
from merlin_ros.actions.hang_watch import hangs
from merlin_ros.deadline import Deadline
from merlin_sm.guard_watch import shared_guard_watch
from merlin_sm.states.merlin_state import PREEMPTED, SUCCEEDED, MerlinState
from merlin_sm.states.ros_calls import check_message, check_name, check_times
from merlin_sm.states.text_keys import check_keys

SERVER_WAIT = 5.0  # s of running time for a server that is not there yet
CANCEL_LIMIT = 2.0  # s of running time within which a server has to stop
LAST_STOP = 2.0  # s of running time for all of them when the program ends
STUCK = "had an active goal and sent no velocity for as long as no_command_limit of the velocity guard allows"

_clients: Dict[str, ActionClient] = {}
_states: Dict[str, "weakref.WeakSet[ActionState]"] = {}  # that use a client; it lasts when others use it, too
_clients_lock = threading.Lock()  # guards _clients and _states
_running: "Dict[ActionState, threading.Event]" = {}  # whether it has no goal that runs
_program_ends = threading.Event()


def goal_class(action_spec: Any) -> type:
    """The class of the goals of an action.

    :raises ValueError: when that is not the generated class of an action.
    """
    fields = getattr(action_spec, "__slots__", ())
    if not {"action_goal", "action_result", "action_feedback"} <= set(fields):
        raise ValueError(f"{action_spec!r} is not the class of an action, as actionlib.msg.TestAction")
    return type(action_spec().action_goal.goal)


def shared_client(name: str, action_spec: type, state: Optional["ActionState"] = None) -> ActionClient:
    """The process's client of an action; many states share it.

    :param state: that uses it as long as it exists; None: it is used until the process ends.
    :raises ValueError: when no action can have the name, or another state uses it with another type.
    """
    check_name("an action", name)
    resolved = rospy.resolve_name(name)
    with _clients_lock:
        known = _clients[resolved].action_spec if resolved in _clients else action_spec
        if known is not action_spec:
            raise ValueError(
                f"action {resolved} is a {known.__name__} in one state and a {action_spec.__name__} here"
            )
        if resolved not in _clients:
            _clients[resolved] = ActionClient(name, action_spec)
            if state is not None:
                _states[resolved] = weakref.WeakSet()
        if state is None:
            _states.pop(resolved, None)
        elif resolved in _states:
            _states[resolved].add(state)
        return _clients[resolved]


def end_unused_clients() -> None:
    """Ends the clients whose states are all gone: what nothing uses must not seem to miss its server."""
    gc.collect()  # a machine and its states refer to each other
    with _clients_lock:
        unused = [name for name, states in _states.items() if not states]
        clients = [_clients.pop(name) for name in unused]
        for name in unused:
            del _states[name]
    for client in clients:
        client.shutdown()


def give_up_goals(owner: str) -> None:
    """Gives up what the states of this process have sent, and will send, on behalf of a goal that is over."""
    with _clients_lock:
        clients = list(_clients.values())
    for client in clients:
        client.give_up_owned(owner)


def _stop_all() -> None:
    """Preempts what runs while a cancel can still be sent: a goal does not end with its program."""
    _program_ends.set()
    running, deadline = list(_running.items()), Deadline(LAST_STOP)
    for state, _ in running:
        state.request_preempt()
    for _, over in running:
        deadline.wait_event(over)


# Added among the hooks that run, it comes behind all of them: a preempt handler preempts the whole tree.
rospy.on_shutdown(lambda: rospy.on_shutdown(_stop_all))


class ActionState(MerlinState):
    """Sends a goal and waits for its end; a preempt cancels it at once.

    Ends with succeeded when the server says SUCCEEDED, with preempted when it was preempted and the server
    stopped, also where that calls the end ABORTED, else with aborted and the reason. A server that does not
    stop within `cancel_limit` is reported by name, and its goal given up: it no longer has an owner. When the
    program ends, its goal is cancelled, and no further one is sent.

    Where a velocity guard names the action among its `motion_servers`, the goal drives: nothing sets off
    while the guard is silent, has stopped the base or does not hear the server; an arrival does not count
    where the guard held the base; a goal for which the guard says that no velocity comes is cancelled.

    :cvar drives: whether goals drive also while no guard has named the action.
    :ivar asks: words or classes that its server has to know.
    :param name: of the action.
    :param action_spec: the generated ``...Action`` class.
    :param goal: the goal, or a function from userdata to the goal; raise ValueError to abort with its text,
        GivenUp when another try cannot help.
    :param on_result: called with userdata and the result after SUCCEEDED; returns an outcome, or None for
        succeeded; raise ValueError to abort with its text, GivenUp when another try cannot help.
    :param outcomes: those that `on_result` may return.
    :param input_keys: userdata that `goal` reads.
    :param output_keys: userdata that `on_result` sets.
    :param server_wait: s of running time to wait for the server.
    :param cancel_limit: s of running time for the server to stop after a cancel.
    """

    drives = False
    asks: Sequence[str] = ()

    def __init__(
        self,
        name: str,
        action_spec: type,
        goal: Any,
        on_result: Optional[Callable[[Any, Any], Optional[str]]] = None,
        outcomes: Sequence[str] = (),
        input_keys: Sequence[str] = (),
        output_keys: Sequence[str] = (),
        server_wait: float = SERVER_WAIT,
        cancel_limit: float = CANCEL_LIMIT,
    ) -> None:
        check_keys(goal, input_keys, output_keys, "input_keys")
        check_keys(on_result, input_keys, output_keys, "input_keys", "result")
        check_times(server_wait=server_wait, cancel_limit=cancel_limit)
        self._goal_class = goal_class(action_spec)
        if not callable(goal):
            check_message("goal", goal, self._goal_class)
        super().__init__(outcomes, input_keys, output_keys)
        self.action = name
        self._goal = goal
        self._on_result = on_result
        self._server_wait = server_wait
        self._cancel_limit = cancel_limit
        self._client = shared_client(name, action_spec, self)
        self._guard = shared_guard_watch()

    def run(self, userdata: Any) -> str:
        """Sends the goal and waits for its end."""
        over = _running[self] = threading.Event()
        over.set()
        try:
            if _program_ends.is_set():
                self.request_preempt()
            return self._run(userdata, over)
        finally:
            del _running[self]
            over.set()

    def _run(self, userdata: Any, over: threading.Event) -> str:
        try:
            goal = self._goal(userdata) if callable(self._goal) else self._goal
            check_message("goal", goal, self._goal_class)
        except (ValueError, LookupError) as error:
            return self.fail_for(error)
        there = self._client.wait_for_server(self._server_wait, self.preempt_requested)
        reason = self._why_no_drive() if there else self._client.absence(self._server_wait)
        if there:
            hangs.wait_settled(self.preempt_requested)
        over.clear()  # first: what ends the program asks for a preempt, then waits
        if self.preempt_requested():
            return PREEMPTED
        return self.fail(reason) if reason else self._carry_out(userdata, goal, over)

    def _carry_out(self, userdata: Any, goal: Any, over: threading.Event) -> str:
        mark = self._guard.mark()
        ended = threading.Event()

        def done(_: ClientGoal) -> None:
            over.set()
            ended.set()

        sent = self._client.send(goal, on_done=done, owner=self.served_goal)
        cancelled = threading.Event()
        said = stuck = reason = ""

        def cancel() -> None:
            nonlocal said
            said = said if cancelled.is_set() else sent.said
            sent.cancel()
            cancelled.set()
            ended.set()

        def look(status: GuardStatus) -> None:
            nonlocal stuck
            if sent.id in status.uncommanded and not cancelled.is_set():
                stuck = f"{self._client.name} {STUCK}"
                cancel()

        self.interruptible(cancel)
        with self._guard.followed(look):
            Deadline(None).wait_event(ended)
        self.interruptible(None)
        if cancelled.is_set() and not sent.wait(self._cancel_limit):
            self.unstopped = self._client.name
            self._client.give_up(sent, "it did not stop in time")
            late = f"{self._client.name} did not stop within {self._cancel_limit:g} s"
            why = sent.said if sent.said != said else ""
            return self.fail(": ".join(filter(None, (stuck, late, why))))
        if sent.status == GoalStatus.SUCCEEDED:
            reason = self._guard.why_unmoved(mark, self._client.name) if self._moves_base() else ""
        elif not self.preempt_requested():
            reason = stuck
        return self.fail(reason) if reason else self._outcome(userdata, sent)

    def _moves_base(self) -> bool:
        return self.drives or self._guard.names(self._client.name)

    def _why_no_drive(self) -> str:
        """Why the velocity guard forbids to send the goal; empty: it does not, or the goal does not drive."""
        if not self._moves_base():
            return ""
        self.interruptible(self._guard.wake)
        reason = self._guard.why_not(self.preempt_requested, self._client.name)
        self.interruptible(None)
        return reason

    def _outcome(self, userdata: Any, sent: ClientGoal) -> str:
        if sent.status == GoalStatus.SUCCEEDED:
            return self.choose(self._on_result, userdata, sent.result) if self._on_result else SUCCEEDED
        if self.preempt_requested() and sent.status != GoalStatus.LOST:
            # A foreign server may end a cancelled goal ABORTED; its text is kept, as it may name a fault.
            if sent.text and sent.status not in (GoalStatus.PREEMPTED, GoalStatus.RECALLED):
                self.reason = f"cancelled: {sent.text}"
            return PREEMPTED
        status = _STATUS_TEXT.get(sent.status, "had not ended when the node did")
        return self.fail(f"{self._client.name} {status}" + (f": {sent.text}" if sent.text else ""))


_STATUS_TEXT = {
    GoalStatus.PREEMPTED: "was preempted by another client",
    GoalStatus.RECALLED: "recalled the goal: another client cancelled it, or sent a newer one",
    GoalStatus.ABORTED: "aborted",
    GoalStatus.REJECTED: "refused the goal",
    GoalStatus.LOST: "was lost",
}

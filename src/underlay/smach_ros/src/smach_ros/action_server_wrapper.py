# SPDX-License-Identifier: Apache-2.0
"""A container offered as an action server."""

import copy
import io
import threading
import traceback
from typing import Any, Dict, Iterable, List, Mapping, Optional, Type

import actionlib
import rospy

import smach
from smach.container import Container
from smach.execution import run_context
from smach.labels import text_of
from smach.state import names
from smach_ros.user_callback import check_slots
from smach_ros.waiting import wait_until_sent

STOP = 2.0  # s of wall time that the goal that runs gets to end when the program ends


class ActionServerWrapper:
    """Executes a container for each goal of an action.

    One goal at a time: a newer one preempts the running one and takes the place of one that waits. When the
    program ends, the running one is preempted, and gets `STOP` to be answered.

    :param server_name: name of the action; relative names and remapping as usual.
    :param action_spec: the generated ``...Action`` class.
    :param wrapped_container: sees of :attr:`userdata` its registered input keys, and writes its output keys.
    :param succeeded_outcomes: container outcomes that mean SUCCEEDED.
    :param aborted_outcomes: container outcomes that mean ABORTED, as all that are not listed do.
    :param preempted_outcomes: container outcomes that mean PREEMPTED.
    :param goal_key: userdata key that gets the goal; an empty one before the first.
    :param feedback_key: userdata key that gets an empty feedback for each goal. A container that declares
        it as input key, or sets it, has it sent after each transition.
    :param result_key: userdata key that gets an empty result for each goal, and holds the result at the end.
    :param goal_slots_map: field of the goal -> userdata key that gets it.
    :param feedback_slots_map: field of the feedback -> key in the container's userdata that it is taken from.
    :param result_slots_map: field of the result -> userdata key that it is taken from.
    :param expand_goal_slots: also puts each field of the goal under its own name.
    :param pack_result_slots: also takes each field of the result from the key of its name, if that is there.
    :ivar userdata: what is set here from outside is there for every goal; the rest ends with its goal, as
        feedback and result do in the container.
    """

    def __init__(
        self,
        server_name: str,
        action_spec: type,
        wrapped_container: Container,
        succeeded_outcomes: Iterable[str] = (),
        aborted_outcomes: Iterable[str] = (),
        preempted_outcomes: Iterable[str] = (),
        goal_key: str = "action_goal",
        feedback_key: str = "action_feedback",
        result_key: str = "action_result",
        goal_slots_map: Optional[Mapping[str, str]] = None,
        feedback_slots_map: Optional[Mapping[str, str]] = None,
        result_slots_map: Optional[Mapping[str, str]] = None,
        expand_goal_slots: bool = False,
        pack_result_slots: bool = False,
    ) -> None:
        action = action_spec()
        self._goal_type = type(action.action_goal.goal)
        self._result_type = type(action.action_result.result)
        self._feedback_type = type(action.action_feedback.feedback)
        self.wrapped_container = wrapped_container
        self.userdata = smach.UserData()
        self.userdata[goal_key] = self._goal_type()
        self.userdata[feedback_key], self.userdata[result_key] = self._feedback_type(), self._result_type()
        self._server_name = server_name
        self._outcome_kinds = self._kinds(
            wrapped_container, succeeded_outcomes, aborted_outcomes, preempted_outcomes
        )
        self._goal_key, self._feedback_key, self._result_key = goal_key, feedback_key, result_key
        self._goal_slots_map = dict(goal_slots_map or {})
        self._feedback_slots_map = dict(feedback_slots_map or {})
        self._result_slots_map = dict(result_slots_map or {})
        check_slots(self._goal_type, self._goal_slots_map, "goal_slots_map")
        check_slots(self._feedback_type, self._feedback_slots_map, "feedback_slots_map")
        check_slots(self._result_type, self._result_slots_map, "result_slots_map")
        self._expand_goal_slots, self._pack_result_slots = expand_goal_slots, pack_result_slots
        packed = self._slots(self._result_type, self._result_slots_map, pack_result_slots)
        answers = [*self._feedback_slots_map.values(), *(key for _, key in packed)]
        self._answer_keys = {feedback_key, result_key, *answers}
        self._changed = threading.Condition(threading.RLock())  # guards the next fields
        self._stopped = False
        self._waiting: Any = None
        self._current: Any = None
        wrapped_container.register_transition_cb(self._send_feedback)
        self._action_server = actionlib.ActionServer(
            server_name, action_spec, self._receive_goal, self._receive_cancel, auto_start=False
        )
        self._worker: Optional[threading.Thread] = None

    @staticmethod
    def _kinds(container: Container, *lists: Iterable[str]) -> Dict[str, str]:
        kinds: Dict[str, str] = {}
        for kind, outcomes in zip(("succeeded", "aborted", "preempted"), lists):
            for outcome in names(outcomes, f"{kind}_outcomes"):
                if outcome not in container.get_registered_outcomes():
                    raise smach.InvalidStateError(
                        f"ActionServerWrapper: {kind}_outcomes names '{outcome}', which the "
                        f"container does not have: {list(container.get_registered_outcomes())}"
                    )
                if kinds.setdefault(outcome, kind) != kind:
                    raise smach.InvalidStateError(
                        f"ActionServerWrapper: outcome '{outcome}' is listed as {kinds[outcome]} "
                        f"and as {kind}"
                    )
        return kinds

    def run_server(self) -> None:
        """Starts to accept goals; does not block."""
        if self._worker is None:
            self._worker = threading.Thread(
                target=self._work, name=f"smach action {self._server_name}", daemon=True
            )
            self._worker.start()
            self._action_server.start()
            rospy.on_shutdown(self._stop)

    def _stop(self) -> None:
        """Ends the worker while an answer still reaches the client."""
        with self._changed:
            self._stopped, runs = True, self._current is not None
            self._changed.notify_all()
        if runs:
            self.wrapped_container.request_preempt()
        if self._worker is not None and not self.wrapped_container.runs_in_this_thread():
            self._worker.join(STOP)
        wait_until_sent([self._action_server.result_pub], STOP)

    def _receive_goal(self, goal: Any) -> None:
        with self._changed:
            replaced, self._waiting = self._waiting, goal
            running = self._current is not None
            self._changed.notify_all()
        if replaced is not None:
            replaced.set_canceled(self._result_type(), "a newer goal took its place")
        if running:
            self.wrapped_container.request_preempt()

    def _receive_cancel(self, goal: Any) -> None:
        with self._changed:
            # actionlib's handles cannot be compared with None.
            waits = self._waiting is not None and goal == self._waiting
            runs = self._current is not None and goal == self._current
            if waits:
                self._waiting = None
        if waits:
            goal.set_canceled(self._result_type(), "cancelled before it began")
        elif runs:
            self.wrapped_container.request_preempt()

    def _work(self) -> None:
        while True:
            with self._changed:
                while self._waiting is None and not self._stopped:
                    self._changed.wait()
                if self._stopped:
                    return
                goal, self._waiting = self._waiting, None
                # From here on a cancel is for this goal, and none from before is.
                self.wrapped_container.prepare_run()
                self._current = goal
            self._serve(goal)

    def _serve(self, goal: Any) -> None:
        goal.set_accepted()
        result = self._result_type()
        kind, text = "aborted", ""
        self.userdata._begin_run()
        outer = run_context.enter(self, run_context.next_number())
        try:
            outcome = self._execute(goal.get_goal())
            kind = "aborted" if outcome is None else self._outcome_kinds.get(outcome, "aborted")
            text = f"outcome of the container: {text_of(outcome)}"
            result = self._result()
            result.serialize(io.BytesIO())  # users fill it, and what cannot be sent would be no answer
        except BaseException as error:  # users' code may raise anything; the client gets its answer
            rospy.logerr(f"Action {self._server_name}: the goal failed\n{traceback.format_exc()}")
            result = self._result_type()
            # Of an error of a state, the lines after the first are its traceback.
            said = traceback.format_exception_only(type(error), error)  # also of one that cannot say its text
            kind, text = "aborted", said[0].partition("\n")[0]
        finally:
            run_context.leave(outer)
            self.userdata._end_run()
        with self._changed:
            self._current = None
        end = {"succeeded": goal.set_succeeded, "preempted": goal.set_canceled, "aborted": goal.set_aborted}
        end[kind](result, text)

    def _execute(self, goal: Any) -> Optional[str]:
        ud = self.userdata
        ud[self._goal_key] = copy.deepcopy(goal)
        # States fill in their fields without making one; new ones, for the last goal's states may have.
        ud[self._feedback_key], ud[self._result_key] = self._feedback_type(), self._result_type()
        if self._expand_goal_slots:
            for slot in goal.__slots__:
                ud[slot] = copy.deepcopy(getattr(goal, slot))
        for slot, key in self._goal_slots_map.items():
            ud[key] = copy.deepcopy(getattr(goal, slot))
        container = self.wrapped_container
        _forget(container, self._answer_keys)
        view = smach.Remapper(
            ud, container.get_registered_input_keys(), container.get_registered_output_keys()
        )
        return container.execute(view)

    def _result(self) -> Any:
        ud = self.userdata
        result = copy.deepcopy(ud[self._result_key]) if self._result_key in ud else self._result_type()
        if not isinstance(result, self._result_type):
            raise TypeError(
                f"userdata key '{self._result_key}' must hold a {self._result_type._type}, not {result!r}"
            )
        for slot, key in self._slots(self._result_type, self._result_slots_map, self._pack_result_slots):
            if key in ud:
                setattr(result, slot, ud[key])
        return result

    @staticmethod
    def _slots(message_type: Type[Any], slots_map: Mapping[str, str], pack: bool) -> List[Any]:
        packed = [(slot, slot) for slot in message_type.__slots__ if pack and slot not in slots_map]
        return [*packed, *slots_map.items()]

    def _send_feedback(self, userdata: smach.UserData, active_states: List[str]) -> None:
        goal = self._current
        slots = [(slot, key) for slot, key in self._feedback_slots_map.items() if key in userdata]
        if goal is None or (self._feedback_key not in userdata and not slots):
            return
        feedback = (
            copy.deepcopy(userdata[self._feedback_key])
            if self._feedback_key in userdata
            else self._feedback_type()
        )
        for slot, key in slots:
            setattr(feedback, slot, userdata[key])
        # rospy would put the half that it can write in front of the next one.
        feedback.serialize(io.BytesIO())
        goal.publish_feedback(feedback)


def _forget(container: Container, keys: Iterable[str]) -> None:
    """Drops what earlier runs have left under some keys, also in nested containers: no goal ends with it."""
    container.userdata._forget(keys)
    for child in container.get_children().values():
        if isinstance(child, Container):
            _forget(child, keys)

"""Serves a state machine as the action ``actions/<name>``."""

import threading
import traceback
from typing import Any, Dict, Iterator, List, Optional

import rospy
from merlin_msgs.msg import RunActionAction, RunActionFeedback, RunActionResult

import smach
from merlin_actions.core.ending import GIVEN_UP, NOT_BEGUN
from merlin_actions.core.machine_end import GoalEnd, MachineEnd, answer_of
from merlin_actions.core.machine_slot import MachineSlot, SlotDecision, SlotStep
from merlin_actions.core.names import DECLARED, action_param, ros_name
from merlin_actions.merlin_action_sm import MerlinActionSM
from merlin_ros.actions.action_server import ActionServer, ServerGoal
from merlin_ros.deadline import Deadline, limit
from merlin_ros.health import ERROR, OK, WARN, Health
from merlin_sm.introspection import show
from merlin_sm.states.action_state import give_up_goals
from merlin_sm.states.merlin_state import ABORTED, PREEMPTED, MerlinState

SHUTDOWN_WAIT = 2.0
"""Wall seconds in which a running machine can stop the robot when its node ends."""

CANCEL_LIMIT = 2.7
"""Running seconds in which a preempted machine has to end: longer than a state gives its server, shorter than
the bridge gives the machine: the server knows in which state the machine hangs, and names it."""


class MerlinActionServer:
    """Runs a :class:`MerlinActionSM` for the goals of its action, one at a time.

    A newer goal preempts an older one. A run that does not end within the limit after its preempt is
    abandoned: what it has sent loses its owner, and another instance of the machine takes its place.

    :param machine: it; its class makes further instances without arguments.
    :param cancel_limit: s of running time for a preempted machine to end; zero or less: no limit.
    """

    def __init__(self, machine: MerlinActionSM, cancel_limit: float = CANCEL_LIMIT) -> None:
        self.operator = machine.operator_name()
        self._name = ros_name(self.operator).upper()
        self._cancel_limit = limit(cancel_limit)
        self._changed = threading.Condition()  # guards the fields below
        self.machine = machine  # of the next goal
        self._machines: Dict[str, MerlinActionSM] = {}  # of the goals that were started
        self._slot = MachineSlot()
        self._goals: Dict[str, ServerGoal] = {}  # accepted or waiting, not answered
        self._crash = ""  # what the last run raised
        self._threads: Dict[str, threading.Thread] = {}  # of the goals
        self._abandoned: List[threading.Thread] = []  # of runs that did not stop
        self._showing = threading.Lock()  # guards the two below
        self._shown: Optional[MerlinActionSM] = None
        self._introspection: Any = None
        self._server = ActionServer(
            f"actions/{ros_name(self.operator)}", RunActionAction, self._receive, self._cancel
        )
        self._prepare(machine)

    def start(self) -> None:
        """Declares the action's facts to its bridge, shows the machine and begins to serve."""
        self._declare()
        self._show()
        self._server.start()

    def renew(self, machine: MerlinActionSM) -> bool:
        """Takes a machine of an edited class for all further goals.

        :param machine: of the same operator.
        :return: whether a goal runs, which the machine of before brings to its end.
        """
        self._prepare(machine)
        with self._changed:
            self.machine = machine
            running = self._slot.running is not None
        self._declare()
        if not running:
            self._show()
        return running

    def _declare(self) -> None:
        """Publishes the action's facts; its bridge reads them when an execution begins."""
        for key in DECLARED:
            rospy.set_param(f"{action_param(self.operator)}/{key}", list(getattr(self.machine, key)))

    def _show(self) -> None:
        """Shows the present machine in place of an earlier one."""
        with self._showing:
            if self._shown is not self.machine:
                if self._introspection is not None:
                    self._introspection.stop()
                self._shown = self.machine
                self._introspection = show(self._name, self._shown)

    def shutdown(self) -> None:
        """Preempts what runs, waits until it has stopped, at most ``SHUTDOWN_WAIT``, and stops serving."""
        with self._changed:
            running = self._slot.running
            decisions = [] if running is None else self._slot.cancel(running, "its host shuts down")
        self._carry_out(decisions)
        with self._changed:
            self._changed.wait_for(lambda: self._slot.running != running or running is None, SHUTDOWN_WAIT)
        self._server.shutdown()
        with self._showing:
            if self._introspection is not None:
                self._introspection.stop()
                self._introspection = None

    def master_lost(self) -> None:
        """Stops what runs: nothing else of the system can be found any more."""
        with self._changed:
            running = self._slot.running
            decisions = [] if running is None else self._slot.cancel(running, "the ROS master is lost")
        self._carry_out(decisions)

    def health(self) -> Health:
        """What the machine does; a warning when its last run raised an exception, or one still hangs."""
        with self._changed:
            running, crash = self._slot.running is not None, self._crash
            self._abandoned = [thread for thread in self._abandoned if thread.is_alive()]
            hanging = len(self._abandoned)
        doing = "running" if running else "idle"
        if hanging:
            return Health(ERROR, f"{doing}; {hanging} earlier runs did not stop and still hang in this host")
        return Health(WARN, f"{doing}; the last run raised {crash}") if crash else Health(OK, doing)

    # --- goals ------------------------------------------------------------------------------------

    def _receive(self, goal: ServerGoal) -> None:
        with self._changed:
            self._goals[goal.id] = goal
            decisions = self._slot.arrive(goal.id)
        self._carry_out(decisions)

    def _cancel(self, goal: ServerGoal) -> None:
        with self._changed:
            decisions = self._slot.cancel(goal.id, goal.cancel_reason)
        self._carry_out(decisions)

    def _carry_out(self, decisions: List[SlotDecision]) -> None:
        """Does what the slot has decided; without the lock."""
        for decision in decisions:
            with self._changed:
                goal = self._goals[decision.goal]
                if decision.what is SlotStep.START:
                    self._machines[goal.id] = self.machine
                machine = self._machines.get(goal.id, self.machine)
            if decision.what is SlotStep.START:
                machine.prepare()
                goal.accept()
                thread = threading.Thread(
                    target=self._run, args=(goal, machine), name=f"machine {self.operator}", daemon=True
                )
                with self._changed:
                    self._threads[goal.id] = thread
                thread.start()
            elif decision.what is SlotStep.PREEMPT:
                goal.request_cancel(decision.reason)
                # In threads of their own: users' code may loop in its preempt.
                for target, what in ((self._preempt, "preempt"), (self._limit, "limit of")):
                    threading.Thread(
                        target=target, args=(goal, machine), name=f"{what} {self.operator}", daemon=True
                    ).start()
            elif decision.what is SlotStep.ABANDON:
                self._abandon(goal, machine)
            else:
                self._forget(goal)
                goal.cancelled(RunActionResult(outcome=PREEMPTED, reason=decision.reason), decision.reason)

    def _forget(self, goal: ServerGoal) -> None:
        with self._changed:
            self._goals.pop(goal.id, None)
            self._machines.pop(goal.id, None)
            self._threads.pop(goal.id, None)
            self._changed.notify_all()

    def _preempt(self, goal: ServerGoal, machine: MerlinActionSM) -> None:
        try:
            machine.cancel()
        except BaseException as error:  # users' code; the limit deals with a machine that goes on
            rospy.logerr(f"{self.operator}: its preempt raised {type(error).__name__}: {error}")

    def _limit(self, goal: ServerGoal, machine: MerlinActionSM) -> None:
        with self._changed:
            if Deadline(self._cancel_limit).wait(self._changed, lambda: self._slot.running != goal.id):
                return
            decisions = self._slot.limit_passed(goal.id)
        self._carry_out(decisions)

    def _abandon(self, goal: ServerGoal, machine: MerlinActionSM) -> None:
        """Answers for a run that did not stop, and replaces its machine."""
        where = ", ".join(_active(machine)) or "its machine"
        culprit = f"{self.operator} in state {where}"
        reason = f"{culprit} did not stop within {self._cancel_limit:g} s"
        rospy.logerr(f"{reason}; another instance takes its place")
        give_up_goals(goal.id)
        try:
            replaced = type(machine)()
            self._prepare(replaced)
        except BaseException as error:  # users' code; the old instance is all there is then
            rospy.logerr(f"{self.operator}: no other instance of {type(machine).__name__}: {error}")
        else:
            with self._changed:
                if self.machine is machine:  # otherwise one of an edited class has taken its place
                    self.machine = replaced
            self._show()
        with self._changed:
            self._abandoned.append(self._threads[goal.id])
        self._forget(goal)
        goal.abort(RunActionResult(ABORTED, reason, culprit, ""), reason)

    # --- a run ------------------------------------------------------------------------------------

    def _run(self, goal: ServerGoal, machine: MerlinActionSM) -> None:
        parameters = {parameter.key: parameter.value for parameter in goal.goal.parameters}
        crash = ""
        missing = [name for name in machine.parameters if name not in parameters]
        for state in _states(machine):
            state.served_goal = goal.id
            state.ran = state.given_up = False
        try:
            if missing:
                outcome, reason = ABORTED, f"{self.operator}: no value for parameter {', '.join(missing)}"
            elif goal.cancel_requested:
                outcome, reason = PREEMPTED, goal.cancel_reason
            else:
                outcome = machine.run_once(parameters)
                reason = machine.reason
        except BaseException as error:  # users' code may raise anything; the bridge still gets its answer
            rospy.logerr(f"{self.operator}: {traceback.format_exc()}")
            crash = f"{type(error).__name__}: {error}"
            outcome, reason = ABORTED, crash
        about = ""
        if outcome == ABORTED and given_up(machine):
            outcome, about = given_up(machine), given_up_about(machine)
        unstopped = ", ".join(state.unstopped for state in _states(machine) if state.unstopped)
        with self._changed:
            if self._goals.get(goal.id) is not goal:  # it was abandoned
                return
            self._crash = crash
            decisions = self._slot.end(goal.id)
        self._forget(goal)
        self._answer(goal, MachineEnd(outcome, reason, unstopped, about))
        self._carry_out(decisions)
        self._show()  # when its class was edited meanwhile

    def _answer(self, goal: ServerGoal, end: MachineEnd) -> None:
        reason = goal.cancel_reason if goal.cancel_requested else None
        how, end = answer_of(end, self.operator, reason)
        answer = {GoalEnd.SUCCEEDED: goal.succeed, GoalEnd.PREEMPTED: goal.cancelled}.get(how, goal.abort)
        answer(RunActionResult(*end), end.reason)

    def _prepare(self, machine: MerlinActionSM) -> None:
        """Registers callbacks that report the present state of a machine."""

        def report(userdata: Any, states: List[str]) -> None:
            with self._changed:
                identity = self._slot.running or ""
                running = self._goals.get(identity) if self._machines.get(identity) is machine else None
            if running is not None:
                running.feedback(RunActionFeedback(state=f"{self._name}/{','.join(states)}"))

        machine.register_start_cb(report)
        machine.register_transition_cb(report)


def _states(container: Any) -> Iterator[MerlinState]:
    """Every MERLIN state of a machine, also of nested ones."""
    for child in container.get_children().values():
        if isinstance(child, MerlinState):
            yield child
        elif isinstance(child, smach.Container):
            yield from _states(child)


def given_up(machine: Any) -> str:
    """What an aborted machine ends with when the state that ran last gave up; empty when none did."""
    states = list(_states(machine))
    if not _gave_up(machine):
        return ""
    # A state that is not one of MERLIN may have done something without a trace.
    traced = len(states) == _leaves(machine)
    return NOT_BEGUN if traced and sum(state.ran for state in states) == 1 else GIVEN_UP


def given_up_about(machine: Any) -> str:
    """The object on account of which a machine gave up; empty when its state names none."""
    return next((state.about for state in _gave_up(machine)), "")


def _gave_up(machine: Any) -> List[MerlinState]:
    return [state for state in _states(machine) if state.given_up and state.reason in machine.reason]


def _leaves(container: Any) -> int:
    children = container.get_children().values()
    return sum(_leaves(child) if isinstance(child, smach.Container) else 1 for child in children)


def _active(container: Any) -> Iterator[str]:
    """The labels of the states that run, innermost only."""
    for label in container.get_active_states():
        child = container.get_children().get(label)
        if child is None:  # SMACH's 'None' of a machine that does not run
            continue
        inner = list(_active(child)) if isinstance(child, smach.Container) else []
        yield from ([f"{label}/{name}" for name in inner] or [label])

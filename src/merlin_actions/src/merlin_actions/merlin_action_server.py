# SPDX-License-Identifier: Apache-2.0
"""Serves a state machine as the action ``actions/<name>``."""

import threading
from functools import partial
from typing import Any, Dict, Iterator, List, Tuple

import rospy
from merlin_msgs.msg import RunActionAction, RunActionFeedback, RunActionResult

import smach
from merlin_actions.core.ending import GIVEN_UP, NOT_BEGUN, MachineEnd, answer_of
from merlin_actions.core.names import CONCURRENT, DECLARED, action_param, ros_name
from merlin_actions.merlin_action_sm import MerlinActionSM
from merlin_actions.shutdown_order import Serving
from merlin_ros.actions.action_server import ActionServer, ServerGoal
from merlin_ros.deadline import call_when_passed, limit
from merlin_ros.health import ERROR, OK, WARN, Health
from merlin_ros.work.goal_end import GoalEnd
from merlin_ros.work.threads import failure_logged, log_failure, start_thread
from merlin_ros.work.work_book import Decision, Policy, Step, WorkBook
from merlin_sm.autonomy import label_text
from merlin_sm.holding.node_holds import node_holds
from merlin_sm.holding.state_hook import hook_states
from merlin_sm.introspection import start_introspection
from merlin_sm.states.action_state import give_up_goals
from merlin_sm.states.merlin_state import ABORTED, PREEMPTED, merlin_states

#: Running seconds in which a preempted machine has to end: longer than a state gives its server, shorter than
#: the bridge gives the machine: the server knows in which state the machine hangs, and names it.
CANCEL_LIMIT = 2.7


class MerlinActionServer(Serving):
    """Runs a :class:`MerlinActionSM` for the goals of its action, as many at once as its class says.

    Where no machine is free, a newer goal preempts the oldest one. A run that does not end within the limit
    after its preempt is abandoned: what it has sent loses its owner, and another instance of the machine
    takes its place.

    :param machine: the action's state machine; its class makes further instances without arguments.
    :param cancel_limit: s of running time for a preempted machine to end; zero or less: no limit.
    """

    def __init__(self, machine: MerlinActionSM, cancel_limit: float = CANCEL_LIMIT) -> None:
        self.operator = machine.operator_name()
        self._name = ros_name(self.operator).upper()
        self._cancel_limit = limit(cancel_limit)
        self._changed = threading.Condition()  # guards the fields below
        self._pool = self._instances(machine)  # of the present class
        self._free = list(self._pool)
        self._machines: Dict[str, MerlinActionSM] = {}  # of the goals that were started
        self._book: WorkBook[str] = WorkBook(Policy.NEWEST, len(self._pool))
        self._goals: Dict[str, ServerGoal] = {}  # accepted or waiting, not answered
        self._ends = False  # nothing begins any more
        self._crash = ""  # what the last run raised
        self._threads: Dict[str, threading.Thread] = {}  # of the goals
        self._abandoned: List[threading.Thread] = []  # of runs that did not stop
        self._showing = threading.Lock()  # guards the field below
        self._shown: List[Tuple[MerlinActionSM, Any]] = []  # machines and what shows them
        self._server = ActionServer(
            f"actions/{ros_name(self.operator)}", RunActionAction, self._receive, self._cancel
        )

    @property
    def machine(self) -> MerlinActionSM:
        """One of the present class."""
        return self._pool[0]

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
        pool = self._instances(machine)
        with self._changed:
            self._pool, self._free = pool, list(pool)
            running = bool(self._book.running)
            decisions = self._book.allow(len(pool))
        self._carry_out(decisions)
        self._declare()
        if not running:
            self._show()
        return running

    def _declare(self) -> None:
        """Publishes the action's facts; its bridge reads them when an execution begins."""
        for key in DECLARED:
            rospy.set_param(f"{action_param(self.operator)}/{key}", list(getattr(self.machine, key)))
        rospy.set_param(f"{action_param(self.operator)}/{CONCURRENT}", len(self._pool))

    def _show(self) -> None:
        """Shows the present machines in place of earlier ones."""
        with self._changed:
            pool = list(self._pool)
        with self._showing:
            for number, machine in enumerate(pool):
                if number < len(self._shown):
                    if self._shown[number][0] is machine:
                        continue
                    self._shown[number][1].stop()
                name = f"{self._name}_{number + 1}" if number else self._name
                self._shown[number : number + 1] = [(machine, start_introspection(name, machine))]
            while len(self._shown) > len(pool):
                self._shown.pop()[1].stop()

    def stop(self) -> None:
        """See :class:`.Serving`."""
        with self._changed:
            self._ends = True
            decisions = self._book.cancel_all("its host shuts down")
        self._carry_out(decisions)

    def wait_stopped(self, seconds: float) -> bool:
        """See :class:`.Serving`."""
        with self._changed:
            return self._changed.wait_for(lambda: not self._goals, seconds)

    def close(self) -> None:
        """See :class:`.Serving`."""
        self._server.shutdown()
        with self._showing:
            while self._shown:
                self._shown.pop()[1].stop()

    def health(self) -> Health:
        """What the machine does; a warning when its last run raised an exception, or one still hangs."""
        with self._changed:
            running, crash = bool(self._book.running), self._crash
            self._abandoned = [thread for thread in self._abandoned if thread.is_alive()]
            hanging = len(self._abandoned)
        doing = "running" if running else "idle"
        if hanging:
            return Health(ERROR, f"{doing}; {hanging} earlier runs did not stop and still hang in this host")
        return Health(WARN, f"{doing}; the last run raised {crash}") if crash else Health(OK, doing)

    # --- goals ------------------------------------------------------------------------------------

    def _receive(self, goal: ServerGoal) -> None:
        with self._changed:
            if self._ends:
                return  # answered when the server is closed: a plan that fails at once is soon given up
            self._goals[goal.id] = goal
            decisions = self._book.arrive(goal.id)
        self._carry_out(decisions)

    def _cancel(self, goal: ServerGoal) -> None:
        self._decide(lambda book: book.cancel(goal.id, goal.cancel_reason))

    def _carry_out(self, decisions: List[Decision]) -> None:
        for decision in decisions:
            with self._changed:
                goal = self._goals.get(decision.key)
            if goal is None:  # it has ended since that was decided
                continue
            if decision.what is Step.REFUSE:
                try:
                    goal.cancelled(
                        RunActionResult(outcome=PREEMPTED, reason=decision.reason), decision.reason
                    )
                finally:
                    self._forget(goal)
                continue
            if decision.what is Step.STOP:
                goal.request_cancel(decision.reason)  # first: a run that begins just now looks at it
            with self._changed:
                if decision.what is Step.RUN:
                    self._machines[goal.id] = self._free.pop() if self._free else self.machine
                machine = self._machines.get(goal.id)
            if machine is None:
                continue
            if decision.what is Step.RUN:
                self._begin(goal, machine)
            elif decision.what is Step.STOP:
                if self._cancel_limit is not None:
                    call_when_passed(self._cancel_limit, partial(self._limit, goal))
                try:  # in a thread of its own: users' code may loop in its preempt
                    start_thread(f"preempt {self.operator}", self._preempt, machine)
                except RuntimeError as error:
                    rospy.logerr(f"{self.operator}: {error}")
                    self._preempt(machine)  # what moves has to stop
            else:
                self._abandon(goal, machine)

    def _begin(self, goal: ServerGoal, machine: MerlinActionSM) -> None:
        """Begins a run in a thread of its own; one that cannot begin has ended."""
        try:
            machine.prepare()
            if goal.accept():
                with self._changed:  # it is noted before it can end
                    thread = start_thread(f"machine {self.operator}", self._run, goal, machine)
                    self._threads[goal.id] = thread
            else:  # it was answered meanwhile: nothing may run for it
                self._end(goal, MachineEnd(ABORTED, "it was answered before it began"), "")
        except BaseException:  # no further thread, or users' code
            crash = log_failure(self.operator)
            self._end(goal, MachineEnd(ABORTED, f"{self.operator} cannot begin: {crash}"), crash)

    def _forget(self, goal: ServerGoal) -> None:
        """A goal is answered: the end of the host does not wait for it any more."""
        with self._changed:
            self._goals.pop(goal.id, None)
            self._threads.pop(goal.id, None)
            self._changed.notify_all()

    def _release(self, goal: ServerGoal) -> None:
        """The machine of a goal can take another one; called with the lock held."""
        machine = self._machines.pop(goal.id, None)
        if machine in self._pool and machine not in self._free:
            self._free.append(machine)

    def _preempt(self, machine: MerlinActionSM) -> None:
        # Users' code; the limit deals with a machine that continues.
        with failure_logged(f"the preempt of {self.operator}", BaseException):
            machine.cancel()

    def _limit(self, goal: ServerGoal) -> None:
        with self._changed:
            runs = goal.id in self._book.running
        if runs:  # in a thread of its own: users' code makes the machine that takes its place
            start_thread(f"limit of {self.operator}", self._decide, lambda book: book.overdue(goal.id))

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
                if machine in self._pool:  # otherwise one of an edited class has taken its place
                    self._pool[self._pool.index(machine)] = replaced
                    self._free.append(replaced)
            self._show()
        with self._changed:
            self._release(goal)
            if goal.id in self._threads:  # otherwise it hangs before its run
                self._abandoned.append(self._threads[goal.id])
        try:
            goal.abort(RunActionResult(ABORTED, reason, culprit, ""), reason)
        finally:
            self._forget(goal)

    # --- a run ------------------------------------------------------------------------------------

    def _run(self, goal: ServerGoal, machine: MerlinActionSM) -> None:
        crash = ""
        try:
            outcome, reason = self._run_machine(goal, machine)
        except BaseException:  # users' code may raise anything; the bridge still gets its answer
            outcome, crash = ABORTED, log_failure(self.operator)
            reason = crash
        about = unstopped = ""
        try:
            if outcome == ABORTED and given_up(machine):
                outcome, about = given_up(machine), machine.about
            unstopped = ", ".join(str(state.unstopped) for state in merlin_states(machine) if state.unstopped)
        except Exception:  # what users' states say of themselves may be anything, too
            failed = log_failure(self.operator)
            crash = crash or failed
        self._end(goal, MachineEnd(outcome, reason, unstopped, about), crash)

    def _end(self, goal: ServerGoal, end: MachineEnd, crash: str) -> None:
        """Answers for a run that has ended, and begins the next one.

        :param crash: what it raised; empty: nothing.
        """
        with self._changed:
            if goal.id not in self._book.running:  # its limit has passed: it is, or just is being, abandoned
                return
            self._crash = crash
            decisions = self._book.end(goal.id)
            self._release(goal)
        try:
            self._answer(goal, end)
        finally:  # the next goal begins whatever became of this answer
            self._forget(goal)
            self._carry_out(decisions)
            self._show()  # when its class was edited meanwhile

    def _run_machine(self, goal: ServerGoal, machine: MerlinActionSM) -> Tuple[str, str]:
        """Runs a machine unless its goal cannot be; returns its outcome and the reason."""
        parameters = {parameter.key: parameter.value for parameter in goal.goal.parameters}
        missing = [name for name in machine.parameters if name not in parameters]
        for state in merlin_states(machine):
            state.served_goal = goal.id
            state.ran, state.given_up, state.unstopped = 0, False, ""
        if missing:
            return ABORTED, f"{self.operator}: no value for parameter {', '.join(missing)}"
        if goal.cancel_requested:
            return PREEMPTED, goal.cancel_reason
        return machine.run_once(parameters), machine.reason

    def _answer(self, goal: ServerGoal, end: MachineEnd) -> None:
        reason = goal.cancel_reason if goal.cancel_requested else None
        how, end = answer_of(end, self.operator, reason)
        answer = {GoalEnd.SUCCEEDED: goal.succeed, GoalEnd.PREEMPTED: goal.cancelled}.get(how, goal.abort)
        answer(RunActionResult(*end), end.reason)

    def _instances(self, machine: MerlinActionSM) -> List[MerlinActionSM]:
        """The machines of an action, as many as its class declares; this one first."""
        machines = [machine, *(type(machine)() for _ in range(1, machine.concurrent))]
        for each in machines:
            self._prepare(each)
        return machines

    def _prepare(self, machine: MerlinActionSM) -> None:
        """Registers callbacks that report the present state of a machine, and puts breakpoints before it."""

        def report(userdata: Any, states: List[str], *within: Any) -> None:
            with self._changed:
                served = [goal for goal, used in self._machines.items() if used is machine]
                running = self._goals.get(served[0]) if served else None
            if running is not None:
                where = "/".join([self._name, *map(label_text, within), ",".join(map(label_text, states))])
                kept = any(machine.keeps([*within, state]) for state in states)
                running.feedback(RunActionFeedback(where, kept))

        def follow(container: Any, *within: Any) -> None:
            container.register_start_cb(report, within)
            container.register_transition_cb(report, within)
            for label, child in container.get_children().items():
                if isinstance(child, smach.Container) and not isinstance(container, smach.Concurrence):
                    follow(child, *within, label)

        follow(machine)
        hook_states(machine, self._name, node_holds.outcomes)


def given_up(machine: Any) -> str:
    """What an aborted machine ends with when the state that ran last gave up; empty when none did."""
    if not machine.given_up:
        return ""
    states = list(merlin_states(machine))
    # A state that is not one of MERLIN may have done something without a trace.
    traced = len(states) == _leaves(machine)
    return NOT_BEGUN if traced and sum(state.ran for state in states) == 1 else GIVEN_UP


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
        text = label_text(label)
        yield from ([f"{text}/{name}" for name in inner] or [text])

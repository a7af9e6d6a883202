# SPDX-License-Identifier: Apache-2.0
"""Executor's engine and machine over a robot of the test's, whose plan can be exchanged."""

import itertools
import math
import threading
from types import SimpleNamespace
from typing import AbstractSet, Any, Callable, FrozenSet, List, Optional, Sequence, Set, Tuple

import rospy
from diagnostic_msgs.msg import KeyValue
from fakes.executor_bench import Goal
from merlin_msgs.msg import GoalDeadline, PlannerStatus, RunningAction
from merlin_msgs.srv import PreviewPlanResponse
from rosplan_dispatch_msgs.msg import ActionDispatch

from merlin_executor.core.agenda import Agenda
from merlin_executor.core.course import Course
from merlin_executor.core.engine import Engine
from merlin_executor.core.outcome import Verdict
from merlin_executor.core.standstill import Halt
from merlin_executor.node.executor_sm import ExecutorSM
from merlin_executor.node.joint_run import PlanningSystem
from merlin_executor.node.own_goals import OwnGoals
from merlin_executor.node.request import Request
from merlin_executor.node.robot_return import RobotReturn
from merlin_planning.dispatch_progress import DispatchResult, unmet_reason
from merlin_planning.knowledge_client import ADD_GOAL, KnowledgeError
from merlin_planning.knowledge_text import parse_goal, step_text, to_pddl
from merlin_planning.planning_client import Planned, PlanningResult
from merlin_ros.call_scope import current_scope
from merlin_ros.service_proxy import ServiceUnavailable
from merlin_test import LONG

DRIVE = SimpleNamespace(
    at_start_del_effects=[SimpleNamespace(name="robot_at", typed_parameters=[KeyValue("from", "place")])],
    at_start_add_effects=[],
)
CHECK = SimpleNamespace(at_start_del_effects=[], at_start_add_effects=[])


def text(action: Any) -> str:
    return step_text(action)


class Robot:
    """A robot that drives and checks, with its knowledge base, planner and dispatcher; all calls are seen."""

    can_exchange = True

    def __init__(self) -> None:
        self.changed = threading.Condition(threading.RLock())  # guards the fields below
        self.facts: Set[str] = {"(robot_at hall)"}
        self.stored: List[str] = []
        self.plan_of_run: List[ActionDispatch] = []
        self.under_way: List[RunningAction] = []
        self.leaving: List[RunningAction] = []
        self.unstopped: Sequence[str] = ()
        self.began: List[str] = []
        self.cancelled: List[str] = []
        self.owners: List[Optional[str]] = []
        self.active = self.interrupted = self.slow_to_stop = False
        self.moves_on = False  # for what was cancelled
        self.slow_to_begin = self.awaited = self.end_awaited = False
        self.steps_done = 0
        self.ended: FrozenSet[int] = frozenset()
        self.on_planned: Callable[[], None] = lambda: None
        self.hanging = ""  # the call that does not answer
        self.hangs = threading.Event()
        self.calls: List[threading.Event] = []  # that hang
        self.asked = 0  # for plans
        self.after: List[str] = []  # of the last one
        self.on_exchange: Callable[[], str] = lambda: ""
        self.impossible = ""
        self.refused = ""  # the goal that the knowledge base does not take
        self.deadlines: List[GoalDeadline] = []  # of the last plan
        self.late = Planned.LATE  # what the planner says where not all are in time
        self.unknown: List[int] = []  # states of the planner for previews without an answer
        self.numbers = itertools.count()
        self.plans: List[List[ActionDispatch]] = []
        self.on_change: Callable[[], None] = lambda: None

    def call(self, name: str) -> None:
        over = self.hang(name)
        if over is None:
            return
        with current_scope().calling(over.set):
            self.hangs.set()
            assert over.wait(LONG), "it was waited for"
            if self.hanging:
                raise ServiceUnavailable(f"{name} does not answer")

    def hang(self, name: str) -> Optional[threading.Event]:
        """What a call that hangs waits for; None: it does not hang."""
        with self.changed:
            if name != self.hanging:
                return None
            self.calls.append(threading.Event())
            return self.calls[-1]

    def answer(self) -> None:
        """What hung answers again."""
        with self.changed:
            self.hanging = ""
            for call in self.calls:
                call.set()

    # --- knowledge base

    def query(self, items: List[Any]) -> List[bool]:
        return [to_pddl(item) in self.facts for item in items]

    def goals(self) -> List[Any]:
        return [item for goal in self.stored for item in parse_goal(goal)]

    def update(self, updates: List[Any]) -> None:
        self.call("update")
        if self.refused in [to_pddl(update.item) for update in updates]:
            raise KnowledgeError(f"refused an update with {self.refused}: its object is unknown")
        with self.changed:
            for update in updates:
                goal = to_pddl(update.item)
                self.stored = [each for each in self.stored if each != goal]
                self.stored += [goal] * (update.kind == ADD_GOAL)
            self.changed.notify_all()

    def operator(self, name: str) -> Any:
        return DRIVE if name == "drive" else CHECK

    # --- planner

    def steps(self, goals: Sequence[str], place: str) -> List[ActionDispatch]:
        made = []
        for goal in goals:
            if goal in self.facts:
                continue
            room = goal.strip("()").split()[1]
            if place != room:
                made.append(("drive", [KeyValue("from", place), KeyValue("to", room)]))
            made.append(("check", [KeyValue("room", room)]))
            place = room
        return [
            ActionDispatch(next(self.numbers), 0, name, parameters, 5.0, 5.0 * number)
            for number, (name, parameters) in enumerate(made)
        ]

    def place(self, facts: Sequence[str]) -> str:
        return next((each.strip("()").split()[1] for each in facts if each.startswith("(robot_at")), "")

    def plan(
        self,
        interruptible: Any,
        without: Any,
        after: Optional[Sequence[str]] = None,
        deadlines: Sequence[GoalDeadline] = (),
    ) -> PlanningResult:
        self.asked += 1
        self.after, self.deadlines = list(after or ()), list(deadlines)
        over = self.hang("plan")
        if over is not None:
            interrupted = threading.Event()
            interruptible(lambda: (interrupted.set(), over.set()))
            self.hangs.set()
            assert over.wait(LONG), "it was waited for"
            if interrupted.is_set():
                return PlanningResult(Planned.CANCELLED)
        if self.impossible in self.stored:
            return PlanningResult(Planned.UNSOLVABLE, "the problem has no plan")
        driven = [each.strip("()").split()[-1] for each in after or () if each.startswith("(drive")]
        checked = [each.replace("check", "checked") for each in after or () if each.startswith("(check ")]
        within = {goal: due.within for due in deadlines for goal in due.goals}
        goals = [goal for goal in self.stored if goal not in checked]
        goals.sort(key=lambda goal: within.get(goal, math.inf))
        plan = self.steps(goals, driven[-1] if driven else self.place(sorted(self.facts)))
        ends = itertools.accumulate(step.duration for step in plan)
        done = {
            f"(checked {step.parameters[0].value})": end
            for step, end in zip(plan, ends)
            if step.name == "check"
        }
        reached = tuple(max(done.get(goal, 0.0) for goal in due.goals) for due in deadlines)
        if any(end > max(0.0, due.within) for end, due in zip(reached, deadlines)):
            return PlanningResult(self.late, "cannot all be in time")
        self.plans.append(plan)
        self.on_planned()
        return PlanningResult(Planned.SOLVED, reached=reached)

    def preview(self, goals: List[str], without: Any, facts: List[str], urgent: bool) -> Any:
        assert urgent, "it is refused beside one that is only shown"
        self.call("preview")
        if self.unknown:
            return PreviewPlanResponse(status=PlannerStatus(state=self.unknown.pop(), reason="not known"))
        actions = [text(step) for step in self.steps(goals, self.place(facts))]
        return PreviewPlanResponse(status=PlannerStatus(state=PlannerStatus.SOLVED), actions=actions)

    # --- dispatcher

    @property
    def begun(self) -> bool:
        with self.changed:
            self.awaited = True
            self.changed.notify_all()
            return self.active

    @property
    def running(self) -> List[RunningAction]:
        with self.changed:
            self.end_awaited = bool(self.leaving)
            self.changed.notify_all()
            return [*self.under_way, *self.leaving] if self.active else []

    def dispatch(self, interruptible: Any, plan: Sequence[ActionDispatch], owner: str) -> DispatchResult:
        def interrupt() -> None:
            with self.changed:
                self.interrupted = True
                self.changed.notify_all()

        with self.changed:
            self.interrupted = False
            self.owners.append(owner)
            interruptible(interrupt)
            self.changed.notify_all()
            assert self.changed.wait_for(lambda: self.interrupted or not self.slow_to_begin, LONG)
            self.plan_of_run, self.active = list(plan), True
            self.steps_done, self.ended = 0, frozenset()
            self.next()
            assert self.changed.wait_for(lambda: self.interrupted or not self.busy(), LONG)
            self.stop(self.under_way)
            self.under_way.clear()
            self.active = False
            self.changed.notify_all()
            unmet = tuple(goal for goal in self.stored if goal not in self.facts)
            unstopped, self.unstopped = tuple(self.unstopped), ()
        interruptible(None)
        done = not unmet and not self.interrupted
        reason = unmet_reason(unmet) if unmet else ""
        return DispatchResult(done, self.interrupted, reason=reason, unmet=unmet, unstopped=unstopped)

    def stop(self, actions: Sequence[RunningAction]) -> None:
        self.cancelled += map(text, actions)
        if any(action.name == "drive" for action in actions):
            self.facts.add("(robot_at anywhere)")

    def busy(self) -> bool:
        return bool(self.under_way or self.plan_of_run)

    def next(self) -> None:
        if not self.under_way and not self.leaving and self.plan_of_run:
            step = self.plan_of_run.pop(0)
            self.began.append(text(step))
            self.under_way.append(
                RunningAction(
                    action_id=step.action_id,
                    name=step.name,
                    parameters=step.parameters,
                    dispatched=rospy.Time.now(),
                )
            )
            if step.name == "drive":
                self.facts.discard(f"(robot_at {step.parameters[0].value})")
        self.changed.notify_all()

    def end_action(self) -> bool:
        """The action that runs succeeds; False: none runs."""
        with self.changed:
            if not self.under_way:
                return False
            action = self.under_way[0]
            room = action.parameters[-1].value
            self.facts.add(f"(robot_at {room})" if action.name == "drive" else f"(checked {room})")
            self.under_way.clear()
            self.steps_done += 1
            self.ended |= {action.action_id}
            self.next()
        self.on_change()
        return True

    def stop_leaving(self) -> None:
        with self.changed:
            self.leaving.clear()
            self.next()
        self.on_change()

    def exchange(
        self, plan: Sequence[ActionDispatch], keep: Sequence[RunningAction], known: AbstractSet[int]
    ) -> str:
        refused = self.on_exchange()
        with self.changed:
            self.changed.notify_all()
            if not self.active:
                return "it carries out no plan"
            if refused:
                return refused
            ids = {action.action_id for action in keep}
            new = [action for action in self.under_way if action.action_id not in ids | known]
            if self.ended - ids - known or [*map(text, new)] != [*map(text, plan[: len(new)])]:
                return "it has gone on since the plan was made"
            ids |= {action.action_id for action in new}
            dropped = [action for action in self.under_way if action.action_id not in ids]
            self.stop(dropped)
            self.under_way = [action for action in self.under_way if action.action_id in ids]
            self.leaving = dropped if self.slow_to_stop else []
            self.plan_of_run = list(plan[len(new) :])
            self.next()
        return ""

    def hand_over(self, owner: str) -> None:
        self.owners.append(owner)

    # --- the rest

    def wait(self, fits: Callable[[], Any]) -> None:
        with self.changed:
            assert self.changed.wait_for(fits, LONG), (self.began, self.stored)


def by(seconds: float) -> rospy.Time:
    """A deadline, s from now; drives and checks of the robot take 5 s each."""
    return rospy.Time(1 + seconds)


def end(request: Request) -> Any:
    return request.goal.end()  # type: ignore[attr-defined]


class Bench:
    """An Executor without its action server."""

    def __init__(self, robot: Robot, path: str, leave_limit: float = LONG) -> None:
        self.robot = robot
        own = OwnGoals(robot, path)  # type: ignore[arg-type]
        guard = SimpleNamespace(
            wait_standing=lambda: not robot.moves_on,
            wait_left=lambda: not robot.moves_on,
            halt=lambda: Halt(guard=True, halted=True),
            brake=lambda reason: None,
            wait_released=lambda stopped: None,
            wake=lambda: None,
        )
        planning = SimpleNamespace(
            read_ahead=lambda: None,
            generate_problem=lambda: robot.call("generate_problem"),
            plan=robot.plan,
            plan_text="",
            parse_plan=lambda: robot.plans.pop(),
            preview=robot.preview,
        )
        recovery = SimpleNamespace(rest=lambda interruptible: "", meanwhile=lambda: frozenset())
        system: Any = PlanningSystem(  # type: ignore[arg-type]
            robot, planning, robot, recovery, guard, RobotReturn(robot, [], 0.1), 0.1, leave_limit=leave_limit
        )
        self.machine = ExecutorSM(system, own, lambda: None, lambda: self.engine)
        robot.on_change = self.machine.dispatch_changed
        self.engine: Engine[Request] = Engine(
            self.machine, lambda: None, self.reported, self.succeeded, lambda *_: None, Agenda(together=20)
        )
        self.engine.start()
        self.order = itertools.count()
        self.ended: List[str] = []  # goals of requests that have succeeded that did not hold

    def succeeded(self, request: Request, verdict: Verdict) -> None:
        if verdict.outcome.achieved:
            self.ended += [goal for goal in request.texts if goal not in self.robot.facts]

    def reported(self) -> None:
        with self.robot.changed:
            self.robot.changed.notify_all()

    def send(self, goal: str, **fields: Any) -> Request:
        request = Request(Goal(goal, **fields), next(self.order), Course(3))  # type: ignore[arg-type]
        self.engine.decide(lambda agenda: agenda.receive(request))
        return request

    def cancel(self, request: Request) -> None:
        self.engine.decide(lambda agenda: agenda.cancel(request))

    def members(self, *requests: Request) -> None:
        """Waits until these run together."""
        self.robot.wait(lambda: self.engine.agenda.together == list(requests))

    def driving(self, goal: str, **fields: Any) -> Request:
        request = self.send(goal, **fields)
        self.robot.wait(lambda: self.robot.began)
        return request

    def joined(self) -> Tuple[Request, Request]:
        """One drives, and another one has joined it."""
        first, second = self.driving("(checked kitchen)"), self.send("(checked bath)")
        self.members(first, second)
        return first, second

    def carry_on(self, *requests: Request) -> None:
        """All that is still to be done succeeds."""
        while not all(request.goal.ends for request in requests):  # type: ignore[attr-defined]
            if not self.robot.end_action():
                with self.robot.changed:
                    self.robot.changed.wait(0.01)

# SPDX-License-Identifier: Apache-2.0
"""What a robot's nodes say, in virtual time, recorded as the monitor records it."""

from pathlib import Path
from typing import Any, Dict, List, Sequence, Tuple

import rospy
from actionlib_msgs.msg import GoalID, GoalStatus
from diagnostic_msgs.msg import KeyValue
from merlin_msgs.msg import (
    DispatchStatus,
    ExecuteActionResult,
    ExecuteResult,
    ExecutorStatus,
    GoalQueue,
    KnowledgeChanges,
    QueuedGoal,
    RunningAction,
)
from rosplan_dispatch_msgs.msg import ActionDispatch, ActionFeedback
from rosplan_knowledge_msgs.msg import KnowledgeItem
from smach_msgs.msg import SmachContainerStatus, SmachContainerStructure

from merlin_explain.execution.moment import Moment
from merlin_explain.execution.recorded_past import RecordedPast
from merlin_monitor.bag.bag_import import RecordedModel
from merlin_monitor.state.knowledge_section import Contents
from merlin_monitor.state.plan_steps import ShownStep
from merlin_pddl.domain_reader import parse_domain
from merlin_test import LONG

BEGIN = 1_700_000_000.0
MISSION, BRIDGES = "/mission", "/merlin_bridges"

DOMAIN = """(define (domain errands)
  (:requirements :typing :negative-preconditions :durative-actions :numeric-fluents :derived-predicates)
  (:types room door - object)
  (:predicates (at ?r - room) (open ?d - door) (joins ?d - door ?a - room ?b - room)
    (tidy ?r - room) (wet ?r - room) (near ?a - room ?b - room) (way ?a - room ?b - room))
  (:functions (battery))
  (:derived (near ?a - room ?b - room) (exists (?d - door) (and (joins ?d ?a ?b) (open ?d))))
  (:derived (way ?a - room ?b - room) (near ?a ?b))
  (:derived (way ?a - room ?b - room) (exists (?c - room) (and (way ?a ?c) (near ?c ?b))))
  (:durative-action drive :parameters (?d - door ?from - room ?to - room) :duration (= ?duration 10)
    :condition (and (at start (at ?from)) (over all (open ?d)) (at start (>= (battery) 5)))
    :effect (and (at start (not (at ?from))) (at end (at ?to)) (at end (decrease (battery) 1))))
  (:durative-action mop :parameters (?r - room) :duration (= ?duration 4)
    :condition (and (over all (at ?r)) (at start (not (wet ?r))))
    :effect (and (at end (tidy ?r)) (at end (wet ?r)))))"""

OPERATORS = {"drive": ("d", "from", "to"), "mop": ("r",)}
Planned = Tuple[str, float, float]  # text, start, duration


class RobotScenario:
    """A robot with two rooms and a door.

    :param begin: s after `BEGIN`.
    :param session: a later scenario with the same one is a further life of the monitor in its run.
    """

    def __init__(self, folder: Path, begin: float = 0.0, session: str = "") -> None:
        self.now = BEGIN + begin
        self.file = folder / "history.sqlite"
        self.model = RecordedModel(self.file, lambda: self.now, self._fail, session)
        self.domain = parse_domain(DOMAIN)
        self.version = 1
        self._steps: Dict[int, Planned] = {}
        self._dispatch = 0
        self.model.start()
        kept = self.model.history.last_state(LONG)
        if kept:
            self.model.knowledge.remember(kept["knowledge"], kept["meta"]["time"])
        self.model.domain(
            {
                "name": "errands",
                "types": {"room": "object", "door": "object"},
                "predicates": {name: _pairs(each) for name, each in self.domain.predicates.items()},
                "functions": {name: _pairs(each) for name, each in self.domain.functions.items()},
                "operators": {name: _pairs(each) for name, each in self.domain.operators.items()},
            }
        )
        objects = {"hall": "room", "kitchen": "room", "attic": "room", "d1": "door", "d2": "door"}
        facts = ["(at hall)", "(open d1)", "(joins d1 hall kitchen)", "(joins d2 kitchen attic)"]
        values = [_item("(battery)", 20.0)]
        self.model.knowledge.replace(
            Contents(objects, list(map(_item, facts)), values, []), "", self.now, True
        )
        self.record()

    @staticmethod
    def _fail(line: str) -> None:
        raise AssertionError(line)

    def past(self, seconds: float = 0.0) -> RecordedPast:
        """What was recorded, up to a time after the begin; 0: all."""
        self.model.settle()
        return RecordedPast(self.file, self.domain, BEGIN + seconds if seconds else 0.0)

    def moment(self, seconds: float = 0.0) -> Moment:
        past = self.past(seconds)
        try:
            return past.moment()
        finally:
            past.close()

    def close(self) -> None:
        self.model.stop()

    def record(self) -> None:
        self.model.tree.set("meta", "time", self.now)
        self.model.record()
        self.now += 0.001  # what comes next is later

    def wait(self, seconds: float) -> None:
        self.now += seconds
        self.record()

    # --- the nodes ------------------------------------------------------------------------------------------

    def changes(
        self,
        client: str,
        add: Sequence[str] = (),
        remove: Sequence[str] = (),
        battery: float = -1,
        at: float = 0.0,
        cleared: bool = False,
    ) -> None:
        """The knowledge changes.

        :param at: the stamp of the change; 0: the present time.
        :param cleared: all but the objects is forgotten first.
        """
        self.version += 1
        message = KnowledgeChanges(version=self.version, client=client)
        message.added, message.removed = list(map(_item, add)), list(map(_item, remove))
        message.cleared = cleared
        for name, entry in self.model.tree.get("knowledge", "objects").items() if cleared else ():
            kind = {"knowledge_type": KnowledgeItem.INSTANCE, "instance_type": entry["type"]}
            message.added.append(KnowledgeItem(instance_name=name, **kind))
        message.changed = [_item("(battery)", battery)] if battery >= 0 else []
        self.model.knowledge.changed(message, at or self.now)
        self.record()

    def plans(self, *steps: Planned, edges: Sequence[Tuple[Any, ...]] = ()) -> None:
        self._steps = dict(enumerate(steps))
        self._dispatch += 1
        shown = [
            ShownStep(key, *_split(text), start, duration)
            for key, (text, start, duration) in self._steps.items()
        ]
        self.model.planned(shown, list(edges), self.now)
        self.record()

    def begins(self, key: int) -> None:
        name, parameters = _split(self._steps[key][0])
        message = ActionDispatch(
            action_id=key, plan_id=self._dispatch, name=name, parameters=_values(parameters)
        )
        self.model.plan.dispatched(message, self.now)
        self._feedback(key, 1, "")

    def succeeds(self, key: int) -> None:
        self._feedback(key, 2, "")

    def fails(self, key: int, reason: str) -> None:
        self._feedback(key, 10, reason)

    def _feedback(self, key: int, status: int, reason: str) -> None:
        information = [KeyValue("reason", reason)] if reason else []
        message = ActionFeedback(
            action_id=key, plan_id=self._dispatch, status=status, information=information
        )
        self.model.plan.feedback(message, self.now)
        self.record()

    def dispatch_ended(self, action: str, reason: str) -> None:
        message = DispatchStatus(plan_id=self._dispatch, failed_action=action, reason=reason)
        self.model.plan.dispatcher(message, self.now)

    def dispatches(self, at: float, *running: Tuple[int, float]) -> None:
        """The dispatcher says what runs.

        :param at: the stamp of its status.
        :param running: the keys of steps, and when they were dispatched.
        """
        message = DispatchStatus(state=DispatchStatus.RUNNING, plan_id=self._dispatch)
        message.header.stamp = rospy.Time.from_sec(at)
        for key, began in running:
            name, parameters = _split(self._steps[key][0])
            fields = {
                "name": name,
                "parameters": _values(parameters),
                "dispatched": rospy.Time.from_sec(began),
            }
            message.running.append(RunningAction(action_id=key, plan_id=self._dispatch, **fields))
        self.model.plan.dispatcher(message, at)
        self.record()

    def runs(self, request: str = "", goals: Sequence[str] = (), **fields: Any) -> None:
        state = ExecutorStatus.RUNNING if request else ExecutorStatus.IDLE
        for name in ("expected_end", "deadline"):
            fields[name] = rospy.Time.from_sec(fields.get(name, 0.0))
        self.model.now.executor(
            ExecutorStatus(state=state, request=request, goals=list(goals), **fields), self.now
        )
        self.record()

    def ends(self, request: str, outcome: int, reason: str = "", at: float = 0.0) -> None:
        """A request ends.

        :param at: the stamp of the result; 0: the present time.
        """
        message = ExecuteActionResult(result=ExecuteResult(outcome=outcome, reason=reason))
        message.status = GoalStatus(goal_id=GoalID(id=request))
        self.model.now.result(message, at or self.now)
        self.record()

    def cancels(self, client: str, request: str) -> None:
        self.model.now.cancel(GoalID(id=request), self.now, client)
        self.record()

    def queues(self, *requests: Dict[str, Any]) -> None:
        waiting = []
        for request in requests:
            times = {
                name: rospy.Time.from_sec(request.pop(name, 0.0)) for name in ("not_before", "expected_begin")
            }
            waiting.append(QueuedGoal(queued=rospy.Time.from_sec(self.now), **times, **request))
        self.model.now.queue(GoalQueue(requests=waiting), self.now)
        self.record()

    def machine(self, path: str, *states: str, into: str = "", outcome: str = "", late: float = 0.0) -> None:
        """A machine is in a state, or has ended with an outcome.

        :param late: s for which its message was under way.
        """
        edges = [(each, state, each) for state in states for each in ("succeeded", "aborted")]
        message = SmachContainerStructure(
            path=path, children=list(states), container_outcomes=["succeeded", "aborted"]
        )
        message.internal_outcomes = [edge[0] for edge in edges]
        message.outcomes_from = [edge[1] for edge in edges]
        message.outcomes_to = [edge[2] for edge in edges]
        self.model.machines.structure("/server", message, self.now, "/host")
        info = f"TERMINATED: {outcome}" if outcome else "HEARTBEAT"
        status = SmachContainerStatus(path=path, active_states=[into or "None"], info=info)
        self.model.machines.status("/server", status, self.now - late, self.now, "/host")
        self.record()


def _pairs(signature: Any) -> List[Tuple[str, str]]:
    return [(variable.label, variable.types[0]) for variable in signature.parameters]


def _split(text: str) -> Tuple[str, List[Tuple[str, str]]]:
    name, *objects = text.strip("()").split()
    return name, list(zip(OPERATORS[name], objects))


def _values(parameters: Sequence[Tuple[str, str]]) -> List[KeyValue]:
    return [KeyValue(*pair) for pair in parameters]


def _item(text: str, value: float = 0.0) -> KnowledgeItem:
    name, *objects = text.strip("()").split()
    kind = KnowledgeItem.FUNCTION if name == "battery" else KnowledgeItem.FACT
    values = [KeyValue("", each) for each in objects]
    return KnowledgeItem(knowledge_type=kind, attribute_name=name, values=values, function_value=value)

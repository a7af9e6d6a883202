# SPDX-License-Identifier: Apache-2.0
"""Short ways to the messages that the tests of the monitor use."""

from typing import Any, List, Tuple

import rospy
from diagnostic_msgs.msg import KeyValue
from merlin_msgs.msg import ExecuteActionResult, ExecutorStatus, KnowledgeChanges, RunningAction
from rosplan_dispatch_msgs.msg import ActionDispatch, ActionFeedback
from rosplan_knowledge_msgs.msg import KnowledgeItem
from smach_msgs.msg import SmachContainerStatus, SmachContainerStructure

from merlin_monitor.state.history_events import Event
from merlin_monitor.text.request_words import OUTCOMES


class Reported(List[Event]):
    """Takes events."""

    def __call__(self, event: Event) -> None:
        self.append(event)

    @property
    def texts(self) -> List[str]:
        return [event.text for event in self]


def fact(name: str, *arguments: str, **fields: Any) -> KnowledgeItem:
    values = [KeyValue("", argument) for argument in arguments]
    return KnowledgeItem(knowledge_type=KnowledgeItem.FACT, attribute_name=name, values=values, **fields)


def value(name: str, *arguments: str, number: float) -> KnowledgeItem:
    item = fact(name, *arguments)
    item.knowledge_type, item.function_value = KnowledgeItem.FUNCTION, number
    return item


def thing(kind: str, name: str) -> KnowledgeItem:
    return KnowledgeItem(knowledge_type=KnowledgeItem.INSTANCE, instance_type=kind, instance_name=name)


def changes(client: str = "/somebody", **fields: Any) -> KnowledgeChanges:
    return KnowledgeChanges(client=client, **fields)


def parameters(*pairs: Tuple[str, str]) -> List[KeyValue]:
    return [KeyValue(*pair) for pair in pairs]


def dispatch(
    identity: int, name: str, *pairs: Tuple[str, str], plan: int = 0, **fields: Any
) -> ActionDispatch:
    return ActionDispatch(
        action_id=identity, plan_id=plan, name=name, parameters=parameters(*pairs), **fields
    )


def feedback(identity: int, status: int, reason: str = "", plan: int = 0) -> ActionFeedback:
    information = parameters(("reason", reason)) if reason else []
    return ActionFeedback(action_id=identity, plan_id=plan, status=status, information=information)


def running(identity: int, name: str, *pairs: Tuple[str, str]) -> RunningAction:
    return RunningAction(
        action_id=identity, name=name, parameters=parameters(*pairs), dispatched=rospy.Time(5)
    )


def executor(state: int, **fields: Any) -> ExecutorStatus:
    return ExecutorStatus(state=state, **fields)


def ended(request: str, outcome: str) -> ExecuteActionResult:
    """The end of a request, with an outcome as the page calls it."""
    result = ExecuteActionResult()
    result.status.goal_id.id = request
    result.result.outcome = OUTCOMES.index(outcome)
    return result


def structure(path: str, children: List[str], edges: List[Tuple[str, str, str]], outcomes: List[str]) -> Any:
    return SmachContainerStructure(
        path=path,
        children=children,
        internal_outcomes=[edge[0] for edge in edges],
        outcomes_from=[edge[1] for edge in edges],
        outcomes_to=[edge[2] for edge in edges],
        container_outcomes=outcomes,
    )


def status(path: str, *active: str, info: str = "HEARTBEAT", data: str = "", initial: str = "") -> Any:
    return SmachContainerStatus(
        path=path,
        active_states=list(active) or ["None"],
        initial_states=[initial] if initial else [],
        info=info,
        local_data=data,
    )

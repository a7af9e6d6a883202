"""Follows the planning system: plans, the planner, the dispatcher, and what the actions answer."""

from typing import Any, Callable, Dict, Optional

import rospy
from merlin_msgs.msg import DispatchStatus, PlannerStatus
from rosplan_dispatch_msgs.msg import ActionDispatch, ActionFeedback, CompletePlan, EsterelPlan
from std_msgs.msg import String

from merlin_monitor.state.monitor_model import MonitorModel
from merlin_monitor.state.plan_order import graph_steps, sequential_steps

_PLANS: Dict[str, Any] = {
    CompletePlan._type: (CompletePlan, sequential_steps),
    EsterelPlan._type: (EsterelPlan, graph_steps),
}


class PlanningListener:
    """Keeps the section of the plan up to date.

    :param state: the model.
    :param planner, parser, dispatcher: names of the planning system's parts.
    """

    def __init__(self, state: MonitorModel, planner: str, parser: str, dispatcher: str) -> None:
        self._state = state
        self._plan_topic = rospy.resolve_name(f"{parser}/complete_plan")
        self._plan_type = ""
        self._plan_subscriber: Optional[rospy.Subscriber] = None
        plan = state.plan
        self.dispatched = self._subscribe(f"{dispatcher}/action_dispatch", ActionDispatch, plan.dispatched)
        """The subscriber of dispatched actions; its connection shows whether the dispatcher lives."""
        self._subscribers = [
            self._subscribe(f"{dispatcher}/action_feedback", ActionFeedback, plan.feedback),
            self._subscribe(f"{dispatcher}/dispatch_status", DispatchStatus, plan.dispatcher),
            self._subscribe(f"{planner}/planner_status", PlannerStatus, plan.planner),
            self._subscribe(
                f"{planner}/planner_output", String, lambda message, at: plan.planner_words(message.data)
            ),
        ]

    def look(self, topics: Dict[str, str]) -> None:
        """Notices which of the two kinds of plan is published."""
        kind = topics.get(self._plan_topic, "")
        if kind == self._plan_type or kind not in _PLANS:
            return
        if self._plan_subscriber is not None:
            self._plan_subscriber.unregister()
        self._plan_type = kind
        message_class, read = _PLANS[kind]

        def receive(message: Any) -> None:
            steps, edges = read(message)
            self._state.inbox.put(self._state.planned, steps, edges, rospy.get_time())

        self._plan_subscriber = rospy.Subscriber(
            self._plan_topic, message_class, receive, queue_size=5, tcp_nodelay=True
        )

    def _subscribe(self, topic: str, message_class: type, take: Callable[[Any, float], None]) -> Any:
        def receive(message: Any) -> None:
            self._state.inbox.put(self._take, take, message, rospy.get_time())

        return rospy.Subscriber(topic, message_class, receive, queue_size=100, tcp_nodelay=True)

    def _take(self, take: Callable[[Any, float], None], message: Any, at: float) -> None:
        take(message, at)
        self._state.now.refresh()

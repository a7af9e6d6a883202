# SPDX-License-Identifier: Apache-2.0
"""The panel of the plan: plans, the planner, the dispatcher, and what the actions answer."""

from typing import Any, Callable, Dict, List

from actionlib_msgs.msg import GoalStatusArray
from merlin_msgs.msg import DispatchStatus, PlannerStatus
from rosplan_dispatch_msgs.msg import ActionDispatch, ActionFeedback, CompletePlan, EsterelPlan
from std_msgs.msg import String

from merlin_monitor.listeners.panel import Panel
from merlin_monitor.listeners.ros_system import RosSystem
from merlin_monitor.state.freshness import Source
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_monitor.state.plan_steps import graph_steps, sequential_steps
from merlin_monitor.truth.worst_truth import BRIDGES, MACHINES

STATUS = GoalStatusArray._type
_PLANS: Dict[str, Any] = {
    CompletePlan._type: (CompletePlan, sequential_steps),
    EsterelPlan._type: (EsterelPlan, graph_steps),
}


class PlanPanel(Panel):
    """The plan's steps, with what becomes of them."""

    name, title, place, width = "plan", "Plan", 20, 7

    def __init__(self, state: MonitorModel, ros: RosSystem) -> None:
        super().__init__(state, ros)
        planner, parser, dispatcher = (
            str(self.ros.parameter(f"~{part}", f"rosplan_{part}"))
            for part in ("planner_interface", "parsing_interface", "plan_dispatcher")
        )
        self._plan_topic = self.ros.resolve(f"{parser}/complete_plan")
        self._plan_type = ""
        self._plan_subscriber: Any = None
        plan = state.plan
        self._dispatched = self._follow(f"{dispatcher}/action_dispatch", ActionDispatch, plan.dispatched)
        self._feedback = self._follow(f"{dispatcher}/action_feedback", ActionFeedback, plan.feedback)
        self._servers: List[str] = []  # topics of the action servers; replaced as a whole
        self._subscribers = [
            self._follow(f"{dispatcher}/dispatch_status", DispatchStatus, plan.dispatcher),
            self._follow(f"{planner}/planner_status", PlannerStatus, plan.planner),
            self._follow(
                f"{planner}/planner_output", String, lambda message, at: plan.planner_words(message.data)
            ),
        ]

    def source(self) -> Source:
        """The dispatcher."""
        return self.source_of(self._dispatched)

    def owners(self) -> Dict[str, Source]:
        """The bridges, and the servers of the actions."""
        found = {}
        for owner, topics in ((BRIDGES, [self._feedback.resolved_name]), (MACHINES, self._servers)):
            nodes = sorted({node for topic in topics for node in self.ros.publishers_of(topic)})
            found[owner] = Source(bool(nodes), (nodes or [""])[0], tuple(nodes[1:]))
        return found

    def look(self, topics: Dict[str, str]) -> None:
        """Notices the action servers, and which of the two kinds of plan is published."""
        actions = self.ros.resolve("actions/")
        self._servers = [
            topic for topic, kind in topics.items() if topic.startswith(actions) and kind == STATUS
        ]
        kind = topics.get(self._plan_topic, "")
        if kind == self._plan_type or kind not in _PLANS:
            return
        if self._plan_subscriber is not None:
            self._plan_subscriber.unregister()
        self._plan_type = kind
        message_class, read = _PLANS[kind]

        def planned(plan: Any, at: float) -> None:
            steps, edges = read(plan)
            self.state.planned(steps, edges, at)

        self._plan_subscriber = self.subscribe(self._plan_topic, message_class, planned)

    def _follow(self, topic: str, message_class: type, take: Callable[[Any, float], None]) -> Any:
        def taken(message: Any, at: float) -> None:
            take(message, at)
            self.state.now.refresh()

        return self.subscribe(topic, message_class, taken)

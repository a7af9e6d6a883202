# SPDX-License-Identifier: Apache-2.0
"""Draws the plan graph for its subscribers, beside the dispatch and never in its way."""

import threading
from typing import TYPE_CHECKING, List, Optional, Set

import rospy
from rosplan_dispatch_msgs.msg import ActionDispatch, EsterelPlan
from std_msgs.msg import String

from merlin_ros.alarms import call_later
from merlin_ros.publishing import OnSubscriber, publish, unregister
from merlin_ros.work.threads import CallQueue
from merlin_rosplan.dispatch.dispatch_schedule import PlanError

if TYPE_CHECKING:  # graphs are imported when there is one
    from merlin_rosplan.dispatch.dispatch_graph import GraphSchedule
    from merlin_rosplan.dispatch.plan_graph import Node, PlanGraph

#: s of wall time between a change and its drawing: the dispatch goes first, and what it does is drawn at once
DELAY = 0.03
SMALL = 500  # edges: such a graph is drawn at every change, a larger one only when there is a subscriber


class PlanGraphDrawer:
    """Publishes the graph of the current plan as DOT text, latched.

    Changes that come faster than it draws are drawn once. A large graph is not drawn without subscribers:
    its text grows with the plan, and so would the cost of every step.

    :param topic: global name.
    :param display_edge_type: colour edges by type.
    """

    def __init__(self, topic: str, display_edge_type: bool = False) -> None:
        self._display_edge_type = display_edge_type
        self._lock = threading.RLock()  # guards the fields below
        self._dirty = self._stopping = False
        self._calls = CallQueue(f"drawer of {topic}")
        self._plan: Optional[EsterelPlan] = None  # not taken apart yet
        self._graph: Optional[PlanGraph] = None
        self._actions: List[ActionDispatch] = []
        self._schedule: Optional[GraphSchedule] = None
        greeter = OnSubscriber(lambda _: self.refresh())  # the latched drawing may be old
        self._publisher = rospy.Publisher(topic, String, greeter, queue_size=1000, latch=True)

    def show(
        self, graph: "PlanGraph", actions: List[ActionDispatch], schedule: Optional["GraphSchedule"]
    ) -> None:
        """Draws another graph; without a schedule nothing of it has happened."""
        with self._lock:
            self._graph, self._actions, self._schedule = graph, list(actions), schedule
            self._plan = None
        self.refresh()

    def show_plan(self, plan: EsterelPlan) -> None:
        """Draws a plan of which nothing has happened; the drawing thread takes it apart."""
        with self._lock:
            self._graph, self._plan = None, plan
        self.refresh()

    def refresh(self) -> None:
        """Has the graph drawn anew, in the drawing thread."""
        with self._lock:
            dirty, self._dirty = self._dirty, True
        if not dirty:
            call_later(DELAY, lambda: self._calls.put(self._draw_now))

    def shutdown(self) -> None:
        """Draws no more."""
        with self._lock:
            self._stopping = True
        unregister(self._publisher)

    def _draw_now(self) -> None:
        with self._lock:
            self._dirty = False
            plan = self._plan
        if plan is not None:
            self._take_apart(plan)
        with self._lock:
            graph, actions, schedule = self._graph, self._actions, self._schedule
        if graph is None or (len(graph.edges) > SMALL and self._publisher.get_num_connections() == 0):
            return
        text = self._draw(graph, actions, schedule)
        with self._lock:
            if not self._stopping:
                publish(self._publisher, String(text))

    def _take_apart(self, plan: EsterelPlan) -> None:
        from merlin_rosplan.dispatch.plan_graph import PlanGraph
        from merlin_rosplan.messages.plan_graph_messages import graph_from_message

        try:
            graph, actions = graph_from_message(plan)
        except PlanError as error:
            rospy.logerr("%s: %s", self._publisher.resolved_name, error)
            graph, actions = PlanGraph(), []
        with self._lock:
            if self._plan is plan:  # else another one has come
                self._graph, self._actions, self._schedule, self._plan = graph, actions, None, None

    def _draw(
        self, graph: "PlanGraph", actions: List[ActionDispatch], schedule: Optional["GraphSchedule"]
    ) -> str:
        from merlin_rosplan.dispatch.plan_graph import NodeType
        from merlin_rosplan.messages.plan_graph_messages import graph_to_dot

        def state(node: "Node") -> str:
            if schedule is not None:
                return schedule.node_state(node)
            return "plan_start" if node.type == NodeType.PLAN_START else "waiting"

        active: Set[int] = schedule.active_edges if schedule is not None else set()
        return graph_to_dot(graph, actions, state, active.__contains__, self._display_edge_type)

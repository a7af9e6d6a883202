"""Draws the plan graph for its subscribers, beside the dispatch and never in its way."""

import threading
from typing import List, Optional, Set

import rospy
from rosplan_dispatch_msgs.msg import ActionDispatch, EsterelPlan
from std_msgs.msg import String

from merlin_ros.publishing import publish
from merlin_rosplan.dispatch.dispatch_graph import GraphSchedule
from merlin_rosplan.dispatch.dispatch_schedule import PlanError
from merlin_rosplan.dispatch.plan_graph import Node, NodeType, PlanGraph
from merlin_rosplan.messages.plan_graph_messages import graph_from_message, graph_to_dot

#: s of wall time between a change and its drawing: the dispatch goes first, and what it does is drawn at once
DELAY = 0.03
SMALL = 500  # edges: such a graph is drawn at every change, a larger one only when there is a subscriber


class PlanGraphDrawer(rospy.SubscribeListener):
    """Publishes the graph of the current plan as DOT text, latched.

    Changes that come faster than it draws are drawn once. A large graph is not drawn without subscribers:
    its text grows with the plan, and so would the cost of every step.

    :param topic: global name.
    :param display_edge_type: colour edges by type.
    """

    def __init__(self, topic: str, display_edge_type: bool = False) -> None:
        super().__init__()
        self._display_edge_type = display_edge_type
        self._changed = threading.Condition()  # guards the fields below
        self._dirty = False
        self._stopping = False
        self._plan: Optional[EsterelPlan] = None  # not taken apart yet
        self._graph: Optional[PlanGraph] = None
        self._actions: List[ActionDispatch] = []
        self._schedule: Optional[GraphSchedule] = None
        self._publisher = rospy.Publisher(
            topic, String, subscriber_listener=self, queue_size=1000, latch=True
        )
        self._thread = threading.Thread(target=self._run, name=f"drawer of {topic}", daemon=True)
        self._thread.start()

    def show(
        self, graph: PlanGraph, actions: List[ActionDispatch], schedule: Optional[GraphSchedule]
    ) -> None:
        """Draws another graph; without a schedule nothing of it has happened."""
        with self._changed:
            self._graph, self._actions, self._schedule = graph, list(actions), schedule
            self._plan = None
        self.refresh()

    def show_plan(self, plan: EsterelPlan) -> None:
        """Draws a plan of which nothing has happened; it is taken apart by the drawing thread."""
        with self._changed:
            self._graph, self._plan = None, plan
        self.refresh()

    def refresh(self) -> None:
        """Has the graph drawn anew, in the drawing thread."""
        with self._changed:
            self._dirty = True
            self._changed.notify()

    def peer_subscribe(self, topic_name: str, topic_publish: object, peer_publish: object) -> None:
        """A subscriber has come: the latched drawing may be old."""
        self.refresh()

    def shutdown(self) -> None:
        """Draws no more."""
        with self._changed:
            self._stopping = True
            self._changed.notify()
        self._thread.join(1.0)
        self._publisher.unregister()

    def _run(self) -> None:
        while not rospy.is_shutdown():
            with self._changed:
                while not self._dirty and not self._stopping:
                    self._changed.wait()
                self._changed.wait_for(lambda: self._stopping, DELAY)
                if self._stopping:
                    return
                self._dirty = False
                plan = self._plan
            if plan is not None:
                self._take_apart(plan)
            with self._changed:
                graph, actions, schedule = self._graph, self._actions, self._schedule
            if graph is None:
                continue
            if len(graph.edges) > SMALL and self._publisher.get_num_connections() == 0:
                continue
            text = self._draw(graph, actions, schedule)
            publish(self._publisher, String(text))

    def _take_apart(self, plan: EsterelPlan) -> None:
        try:
            graph, actions = graph_from_message(plan)
        except PlanError as error:
            rospy.logerr("%s: %s", self._publisher.resolved_name, error)
            graph, actions = PlanGraph(), []
        with self._changed:
            if self._plan is plan:  # else another one has come
                self._graph, self._actions, self._schedule, self._plan = graph, actions, None, None

    def _draw(
        self, graph: PlanGraph, actions: List[ActionDispatch], schedule: Optional[GraphSchedule]
    ) -> str:
        def state(node: Node) -> str:
            if schedule is not None:
                return schedule.node_state(node)
            return "plan_start" if node.type == NodeType.PLAN_START else "waiting"

        active: Set[int] = schedule.active_edges if schedule is not None else set()
        return graph_to_dot(graph, actions, state, active.__contains__, self._display_edge_type)

# SPDX-License-Identifier: Apache-2.0
"""ROSPlan's two plan dispatchers: simple and Esterel."""

from typing import TYPE_CHECKING, Optional

from rosplan_dispatch_msgs.msg import ActionDispatch, CompletePlan, EsterelPlan

from merlin_rosplan.dispatch.dispatch_schedule import Ongoing, PlannedAction
from merlin_rosplan.dispatcher.plan_dispatcher import NOTHING, SCOPE, PlanDispatcher
from merlin_rosplan.messages.plan_graph_drawer import PlanGraphDrawer

if TYPE_CHECKING:  # what carries out a plan is imported when the node serves
    from merlin_rosplan.dispatch.dispatch_graph import GraphSchedule, SequentialSchedule


class SimplePlanDispatcher(PlanDispatcher):
    """Runs a CompletePlan, one action after the other."""

    def make_schedule(self, plan: CompletePlan, ongoing: Ongoing = NOTHING) -> "SequentialSchedule":
        """The list, in its order."""
        from merlin_rosplan.dispatch.dispatch_graph import SequentialSchedule

        actions = [planned_action(message) for message in plan.plan]
        if ongoing != NOTHING:
            from merlin_rosplan.rest.exchange import continued_list

            actions = continued_list(actions, ongoing)
        return SequentialSchedule(actions)


class EsterelPlanDispatcher(PlanDispatcher):
    """Runs an EsterelPlan, in parallel where its graph allows; draws the graph on ``plan_graph``."""

    plan_class = EsterelPlan
    publishes_feedback = False

    def __init__(self, scope: str = SCOPE) -> None:
        self._drawer: Optional[PlanGraphDrawer] = None  # plans may arrive before the other fields are set
        self._bounds, self._fraction = False, 0.0
        super().__init__(scope)
        self._bounds = self.flag("timeout_actions", False)
        self._fraction = self.number("action_timeout_fraction", 0.0, 0.0)
        self._drawer = self.own(
            PlanGraphDrawer(
                self.resolve(str(self.param("plan_graph_topic", "plan_graph"))),
                self.flag("display_edge_type", False),
            )
        )
        with self._state:
            plan = self._plan
        if plan is not None:
            self.received(plan)

    def prepare(self) -> None:
        """Imports what the first graph needs, too."""
        from merlin_rosplan.messages import plan_graph_messages  # noqa: F401

        super().prepare()

    def make_schedule(self, plan: EsterelPlan, ongoing: Ongoing = NOTHING) -> "GraphSchedule":
        """The graph; with `~timeout_actions` its time bounds are kept."""
        from merlin_rosplan.dispatch.dispatch_graph import GraphSchedule
        from merlin_rosplan.messages.plan_graph_messages import graph_from_message

        graph, messages = graph_from_message(plan)
        actions = [planned_action(message) for message in messages]
        if ongoing != NOTHING:
            from merlin_rosplan.rest.exchange import continued_graph

            actions = continued_graph(graph, actions, ongoing, self._topics.operator)
            messages += [self._topics.message(action, action.name) for action in ongoing.kept]
        schedule = GraphSchedule(graph, actions, self._bounds, self._fraction)
        if self._drawer is not None:
            self._drawer.show(graph, messages, schedule)
        return schedule

    def received(self, plan: EsterelPlan) -> None:
        """Draws a plan that has just come, unless one runs."""
        with self._state:
            idle = self._turn.dispatch is None
        if idle and self._drawer is not None:
            self._drawer.show_plan(plan)

    def progressed(self) -> None:
        """Draws the graph again."""
        if self._drawer is not None:
            self._drawer.refresh()


def planned_action(message: ActionDispatch) -> PlannedAction:
    """An action of a plan message."""
    return PlannedAction(
        message.action_id,
        message.name,
        tuple((entry.key, entry.value) for entry in message.parameters),
        message.duration,
        message.dispatch_time,
    )

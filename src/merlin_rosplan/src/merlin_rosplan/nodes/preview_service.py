# SPDX-License-Identifier: Apache-2.0
"""Plans that the planner interface makes to be shown, and nothing else."""

import dataclasses
import threading
from typing import Callable

import rospy
from merlin_msgs.msg import PlannerStatus
from merlin_msgs.srv import PreviewPlanRequest, PreviewPlanResponse
from rosplan_dispatch_msgs.srv import PlanningServiceRequest

from merlin_pddl.domain_reader import read_domain
from merlin_pddl.plan_text import PlanTextError
from merlin_pddl.text_reader import PddlError
from merlin_ros.ports.service_server import while_wanted
from merlin_rosplan.knowledge.foreseen import after_actions, with_facts
from merlin_rosplan.knowledge.knowledge_checks import UpdateRefused
from merlin_rosplan.messages.knowledge_snapshot import KnowledgeBaseError
from merlin_rosplan.nodes.world_reader import WorldReader
from merlin_rosplan.planning.planner import NOT_KNOWN, PlannerSettings, PlannerState, PlanningOutcome, dues_of
from merlin_rosplan.supervision.plan_preview import Previews, Wanted, steps_of
from merlin_rosplan.transport.component import Component

#: Nice value of what plans: the robot's own planning goes first.
NICENESS = 10


class PreviewService:
    """Answers ``preview_plan`` of a component. Neither its topics nor its planning know of it.

    :param component: the planner interface.
    :param settings: of its planner.
    :param parameters: reads the domain's file and the planner's command.
    """

    def __init__(
        self,
        component: Component,
        settings: PlannerSettings,
        parameters: Callable[[], PlanningServiceRequest],
    ) -> None:
        self._parameters = parameters
        self._reading = threading.Lock()  # orders the uses of the reader
        self._world: WorldReader = component.own(WorldReader(component.knowledge_base))
        self._settings = settings
        self._previews: Previews = component.own(Previews(niceness=NICENESS, while_wanted=while_wanted))
        self._forecasts: Previews = component.own(Previews(niceness=NICENESS, while_wanted=while_wanted))

    def answer(self, request: PreviewPlanRequest) -> PreviewPlanResponse:
        """The plan for some goals, or why there is none."""
        wanted = self._parameters()
        text = ""
        try:
            with self._reading:
                domain, problem = self._world.snapshot()
            if request.after or request.then:
                if not domain.operators:  # as it is read over ROS
                    domain = read_domain(wanted.domain_path)
                problem = after_actions(domain, problem, request.after, request.then)
            with_facts(domain, problem, request.facts)
            settings = dataclasses.replace(
                self._settings, command=wanted.planner_command, dues=dues_of(request.deadlines)
            )
            # What looks ahead by itself keeps no reader of a plan waiting.
            previews = self._forecasts if request.deadlines else self._previews
            outcome, text = previews.plan(
                (domain, problem),
                wanted.domain_path,
                Wanted(request.goals, request.without, request.include),
                settings,
            )
            steps = steps_of(outcome.plan)
        except (KnowledgeBaseError, PlanTextError, PddlError, UpdateRefused) as error:
            outcome, steps = PlanningOutcome(PlannerState.INVALID, str(error)), []
        status = PlannerStatus(
            state=int(outcome.state), reason=outcome.reason, planner=outcome.planner, seconds=outcome.seconds
        )
        status.header.stamp = rospy.Time.now()
        return PreviewPlanResponse(
            status,
            [str(step) for step in steps],
            [step.time for step in steps],
            [step.duration for step in steps],
            list(outcome.reached),
            [
                max(0.0, time - deadline.within) if time != NOT_KNOWN else NOT_KNOWN
                for time, deadline in zip(outcome.reached, request.deadlines)
            ],
            text,
        )

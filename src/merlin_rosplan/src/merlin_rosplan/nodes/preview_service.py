# SPDX-License-Identifier: Apache-2.0
"""Plans that the planner interface makes to be shown, and nothing else."""

import dataclasses
import threading
from typing import Callable, Tuple

import rospy
from merlin_msgs.msg import PlannerStatus
from merlin_msgs.srv import PreviewPlanRequest, PreviewPlanResponse
from rosplan_dispatch_msgs.srv import PlanningServiceRequest

from merlin_pddl.domain import Domain
from merlin_pddl.domain_reader import read_domain
from merlin_pddl.plan_text import PlanTextError
from merlin_pddl.problem import Problem
from merlin_pddl.text_reader import PddlError
from merlin_ros.ports.service_server import while_wanted
from merlin_rosplan.knowledge.foreseen import after_actions, with_facts
from merlin_rosplan.knowledge.knowledge_checks import UpdateRefused
from merlin_rosplan.messages.knowledge_snapshot import KnowledgeBaseError
from merlin_rosplan.nodes.world_reader import WorldReader
from merlin_rosplan.planning.planner_settings import PlannerSettings, dues_of
from merlin_rosplan.planning.planning_outcome import NOT_KNOWN, PlannerState, PlanningOutcome
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
        self._urgent: Previews = component.own(Previews(while_wanted=while_wanted))

    def answer(self, request: PreviewPlanRequest) -> PreviewPlanResponse:
        """The plan for some goals, or why there is none."""
        wanted = self._parameters()
        try:
            with self._reading:
                world = self._world.snapshot()
        except KnowledgeBaseError as error:
            answer = _answered(PlanningOutcome(PlannerState.INVALID, str(error)))
        else:
            settings = dataclasses.replace(self._settings, command=wanted.planner_command)
            # What looks ahead by itself keeps no reader of a plan waiting, and neither keeps the robot.
            previews = self._forecasts if request.deadlines else self._previews
            previews = self._urgent if request.urgent else previews
            answer = look_for_plan(request, world, wanted.domain_path, settings, previews)
        answer.status.header.stamp = rospy.Time.now()
        return answer


def look_for_plan(
    request: PreviewPlanRequest,
    world: Tuple[Domain, Problem],
    domain_path: str,
    settings: PlannerSettings,
    previews: Previews,
) -> PreviewPlanResponse:
    """The plan for some goals, or why there is none; its status has no stamp.

    :param world: domain and state.
    :param domain_path: PDDL file of the domain.
    """
    domain, problem = world
    text = ""
    try:
        if request.after or request.then:
            if not domain.operators:  # as it is read over ROS
                domain = read_domain(domain_path)
            problem = after_actions(domain, problem, request.after, request.then)
        with_facts(domain, problem, request.facts)
        outcome, text = previews.plan(
            (domain, problem),
            domain_path,
            Wanted(request.goals, request.without, request.include),
            dataclasses.replace(settings, dues=dues_of(request.deadlines)),
        )
        steps = steps_of(outcome.plan)
    except (PlanTextError, PddlError, UpdateRefused) as error:
        return _answered(PlanningOutcome(PlannerState.INVALID, str(error)), text)
    answer = _answered(outcome, text)
    answer.actions = [str(step) for step in steps]
    answer.starts = [step.time for step in steps]
    answer.durations = [step.duration for step in steps]
    answer.reached = list(outcome.reached)
    answer.late = [
        max(0.0, time - deadline.within) if time != NOT_KNOWN else NOT_KNOWN
        for time, deadline in zip(outcome.reached, request.deadlines)
    ]
    return answer


def _answered(outcome: PlanningOutcome, problem: str = "") -> PreviewPlanResponse:
    return PreviewPlanResponse(status=PlannerStatus(**outcome.status), problem=problem)

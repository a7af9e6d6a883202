# SPDX-License-Identifier: Apache-2.0
"""All components of the planning system in one process, each with the names it has as a node of its own."""

import importlib
import sys
from typing import Any, Dict, Tuple

import rospy

from merlin_ros.lean_start import importing
from merlin_rosplan.transport.component import Component, ComponentError, run_components

#: kind -> (module, class)
KINDS: Dict[str, Tuple[str, str]] = {
    "knowledge_base": ("merlin_rosplan.nodes.knowledge_base", "KnowledgeBase"),
    "problem_interface": ("merlin_rosplan.nodes.problem_interface", "ProblemInterface"),
    "planner_interface": ("merlin_rosplan.nodes.planner_interface", "PlannerInterface"),
    "simple_plan_parser": ("merlin_rosplan.nodes.plan_parser_node", "SimplePlanParser"),
    "esterel_plan_parser": ("merlin_rosplan.nodes.plan_parser_node", "EsterelPlanParser"),
    "simple_plan_dispatcher": ("merlin_rosplan.dispatcher.simple_and_esterel", "SimplePlanDispatcher"),
    "esterel_plan_dispatcher": ("merlin_rosplan.dispatcher.simple_and_esterel", "EsterelPlanDispatcher"),
    "sensing_interface": ("merlin_rosplan.nodes.sensing_interface", "SensingInterface"),
}

#: scope -> kind, when `~components` does not say otherwise
DEFAULT_COMPONENTS: Dict[str, str] = {
    "rosplan_knowledge_base": "knowledge_base",
    "rosplan_problem_interface": "problem_interface",
    "rosplan_planner_interface": "planner_interface",
    "rosplan_parsing_interface": "esterel_plan_parser",
    "rosplan_plan_dispatcher": "esterel_plan_dispatcher",
}

DEFAULT_SCOPES: Dict[str, str] = {
    **{kind: scope for scope, kind in DEFAULT_COMPONENTS.items()},
    "simple_plan_parser": "rosplan_parsing_interface",
    "simple_plan_dispatcher": "rosplan_plan_dispatcher",
    "sensing_interface": "rosplan_sensing_interface",
}


def component_class(kind: str) -> Any:
    """The class of one of :data:`KINDS`."""
    module, name = KINDS[kind]
    with importing():
        return getattr(importlib.import_module(module), name)


def make_components(_scope: str) -> None:
    """Makes the components that `~components` (scope: kind) names, in that order."""
    components = rospy.get_param("~components", DEFAULT_COMPONENTS)
    if not isinstance(components, dict) or not all(isinstance(kind, str) for kind in components.values()):
        raise ComponentError("~components must map scopes to kinds of component")
    order = list(KINDS)
    for kind in components.values():
        if kind not in KINDS:
            raise ComponentError(f"'{kind}' is not a kind of component; there are {', '.join(sorted(KINDS))}")
    # The parameter server keeps no order of a mapping: a server starts before its clients, and answers
    # before they are imported.
    for scope, kind in sorted(components.items(), key=lambda entry: (order.index(entry[1]), entry[0])):
        component: Component = component_class(kind)(scope)
        rospy.logdebug("%s started", component.scope)


def run_kind(kind: str) -> None:
    """``main()`` of an executable with one component of a kind; the node's name is its scope.

    :param kind: of :data:`KINDS`; without ``simple_`` or ``esterel_``: with what `~kind` says (``esterel``).
    """

    def make(scope: str) -> Component:
        found = kind
        if kind not in KINDS:
            which = str(rospy.get_param("~kind", "esterel"))
            if which not in ("simple", "esterel"):
                raise ComponentError(f"~kind is '{which}', expected 'simple' or 'esterel'")
            found = f"{which}_{kind}"
        return component_class(found)(scope)

    sys.exit(run_components(DEFAULT_SCOPES.get(kind) or DEFAULT_SCOPES[f"simple_{kind}"], make))


def main() -> None:
    """Entry point of ``rosrun merlin_rosplan planning_system``."""
    sys.exit(run_components("planning_system", make_components))

# SPDX-License-Identifier: Apache-2.0
"""Node: the Executor."""

import math
from typing import Any, Collection, Dict, List, Mapping

import rospy

from merlin_executor.announced import robots_of_plan
from merlin_executor.core.agenda import TOGETHER
from merlin_executor.core.replanning import REPLAN_WAIT, SAME_FAILURES
from merlin_executor.core.standstill import STAND_WAIT
from merlin_executor.core.ticket import OVERTAKE_LIMIT
from merlin_executor.node.executor import Executor
from merlin_planning.dispatch_client import STUCK_AFTER
from merlin_planning.knowledge_client import DEFAULT_KNOWLEDGE_BASE, knowledge_client
from merlin_planning.planning_client import PlanningClient, StageError
from merlin_ros.actions.lease import LOSE_AFTER, SUSPEND_AFTER
from merlin_ros.health import HealthReporter
from merlin_ros.master.master_link import ERRORS, bounded_master
from merlin_ros.master.namesake import living_namesake
from merlin_ros.node import keep_foreign_nodes, run_node
from merlin_ros.parameters import ParameterError, flag, graph_name, number, whole

STATUS_TYPE = "merlin_msgs/ExecutorStatus"


def main() -> int:
    """Runs the node; returns the exit code."""
    return run_node("merlin_executor", _start, missing=(StageError,))


def _start() -> None:
    options = _options()  # a wrong one is reported before the wait for the planning system
    wait = number("~planning_system_wait", 30.0, 0.0)
    knowledge = knowledge_client(graph_name("~knowledge_base", DEFAULT_KNOWLEDGE_BASE))
    dispatcher = graph_name("~plan_dispatcher", "rosplan_plan_dispatcher")
    names = {
        key: graph_name(f"~{key}_interface", f"rosplan_{key}_interface") for key in ("problem", "planner")
    }
    planning = PlanningClient(parser=graph_name("~parsing_interface", "rosplan_parsing_interface"), **names)
    if not knowledge.wait(wait):
        raise StageError(
            f"the planning system's knowledge base {knowledge.name} does not run after {wait:g} s; "
            "is it launched?"
        )
    planning.wait(wait)
    for other in living_executors(dispatcher):
        raise StageError(_second(other))
    try:
        executor = Executor(knowledge, planning, dispatcher, **options)
    except OSError as error:
        raise ParameterError(f"parameter ~goals_file cannot be used: {error}") from error
    executor.start()
    rospy.on_shutdown(executor.shutdown)
    others = living_executors(dispatcher)
    if must_yield(rospy.get_name(), others):
        raise StageError(_second(others[0]))
    keep_foreign_nodes()
    HealthReporter({"requests": executor.health}).start()
    rospy.loginfo("the executor is ready")


def _options() -> Dict[str, Any]:
    return {
        "cancel_deadline": number("~cancel_deadline", 5.0, -math.inf),
        "max_replans": whole("~max_replans", 3, 0),
        "same_failures": whole("~same_failures", SAME_FAILURES, 1),
        "replan_wait": number("~replan_wait", REPLAN_WAIT, 0.0),
        "goals_file": str(rospy.get_param("~goals_file", "")),
        "return_wait": number("~planning_system_return", 8.0, 0.0),
        "robots": robots_of_plan(),
        "stand_wait": number("~stand_wait", STAND_WAIT, 0.0),
        "stuck_after": number("~stuck_after", STUCK_AFTER, -math.inf),
        "overtake_limit": number("~overtake_limit", OVERTAKE_LIMIT, 0.0),
        "together": whole("~together", TOGETHER, 1),
        "look_ahead": flag("~look_ahead", True),
        "leave_limit": number("~leave_limit", 2.0, 0.0),
        "owner_timeout": number("~owner_timeout", LOSE_AFTER, SUSPEND_AFTER),
    }


def living_executors(dispatcher: str) -> List[str]:
    """Names of the other nodes that serve as an Executor on the same planning system, and live.

    :param dispatcher: name of its dispatcher.
    """
    me, topic = rospy.get_name(), f"{rospy.resolve_name(dispatcher)}/action_dispatch"
    master = bounded_master()
    try:
        publishers = dict(master.getSystemState()[0])
        found = other_executors(me, topic, publishers, dict(master.getTopicTypes()))
        return [name for name in found if living_namesake(name, master) is not None]
    except ERRORS as error:
        raise StageError(f"the master cannot say whether another executor runs: {error}") from error


def _second(other: str) -> str:
    return (
        f"the node {other} is an executor of the same planning system already, and two would disturb each "
        "other's plans; end one of them, or give this one a planning system of its own"
    )


def other_executors(
    me: str, dispatch_topic: str, publishers: Mapping[str, Collection[str]], types: Mapping[str, str]
) -> List[str]:
    """The other nodes that serve as an Executor and dispatch through the same dispatcher.

    An Executor is known by its status, whatever its namespace, and by what it publishes to the dispatcher.
    One that is still starting publishes no status.

    :param me: name of this node.
    :param dispatch_topic: ``<dispatcher>/action_dispatch``, resolved.
    :param publishers: topic → nodes, as the master lists them.
    :param types: topic → message type.
    :return: their names, sorted.
    """
    executors = {
        node for topic, kind in types.items() if kind == STATUS_TYPE for node in publishers.get(topic, ())
    }
    return sorted((executors & set(publishers.get(dispatch_topic, ()))) - {me})


def must_yield(me: str, others: Collection[str]) -> bool:
    """Whether this node gives way after all: both have begun to serve in the same moment."""
    return any(other < me for other in others)

"""Node: the Executor."""

import math

import rospy

from merlin_executor.executor import Executor
from merlin_sm.health import HealthReporter
from merlin_sm.knowledge_client import DEFAULT_KNOWLEDGE_BASE, knowledge_client
from merlin_sm.node import run_node
from merlin_sm.parameters import ParameterError, number
from merlin_sm.planning_client import PlanningClient, StageError


def main() -> int:
    """Runs the node; returns the exit code."""
    return run_node("merlin_executor", _start, StageError)


def _start() -> None:
    wait = number("~planning_system_wait", 30.0, 0.0)
    knowledge = knowledge_client(rospy.get_param("~knowledge_base", DEFAULT_KNOWLEDGE_BASE))
    names = {
        key: rospy.get_param(f"~{key}_interface", f"rosplan_{key}_interface")
        for key in ("problem", "planner")
    }
    planning = PlanningClient(
        parser=rospy.get_param("~parsing_interface", "rosplan_parsing_interface"), **names
    )
    if not knowledge.wait(wait):
        raise StageError(f"no knowledge base {knowledge.name} after {wait:g} s; is it launched?")
    planning.wait(wait)
    try:
        executor = Executor(
            knowledge,
            planning,
            dispatcher=rospy.get_param("~plan_dispatcher", "rosplan_plan_dispatcher"),
            cancel_deadline=number("~cancel_deadline", 5.0, -math.inf),
            max_replans=round(number("~max_replans", 3, 0)),
            goals_file=str(rospy.get_param("~goals_file", "")),
        )
    except OSError as error:
        raise ParameterError(f"parameter ~goals_file cannot be used: {error}") from error
    executor.start()
    HealthReporter({"requests": executor.health}).start()
    rospy.loginfo("the executor is ready")
    rospy.on_shutdown(executor.shutdown)

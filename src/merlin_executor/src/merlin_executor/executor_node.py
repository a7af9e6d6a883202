"""Node: the Executor."""

import sys

import rospy

from merlin_executor.executor import Executor
from merlin_sm.health import HealthReporter
from merlin_sm.knowledge_client import DEFAULT_KNOWLEDGE_BASE, knowledge_client
from merlin_sm.planning_client import PlanningClient, StageError


def main() -> None:
    """Runs the node."""
    rospy.init_node("merlin_executor")
    wait = float(rospy.get_param("~planning_system_wait", 30.0))
    knowledge = knowledge_client(rospy.get_param("~knowledge_base", DEFAULT_KNOWLEDGE_BASE))
    names = {
        key: rospy.get_param(f"~{key}_interface", f"rosplan_{key}_interface")
        for key in ("problem", "planner")
    }
    planning = PlanningClient(
        parser=rospy.get_param("~parsing_interface", "rosplan_parsing_interface"), **names
    )
    try:
        if not knowledge.wait(wait):
            if rospy.is_shutdown():
                return
            raise StageError(f"no knowledge base {knowledge.name} after {wait:g} s; is it launched?")
        planning.wait(wait)
    except StageError as error:
        rospy.logfatal(f"merlin_executor: {error}")
        sys.exit(1)
    try:
        executor = Executor(
            knowledge,
            planning,
            dispatcher=rospy.get_param("~plan_dispatcher", "rosplan_plan_dispatcher"),
            cancel_deadline=float(rospy.get_param("~cancel_deadline", 5.0)),
            max_replans=int(rospy.get_param("~max_replans", 3)),
            goals_file=str(rospy.get_param("~goals_file", "")),
        )
    except OSError as error:
        rospy.logfatal(f"merlin_executor: the parameter ~goals_file cannot be used: {error}")
        sys.exit(1)
    executor.start()
    HealthReporter({"requests": executor.health}).start()
    rospy.loginfo("the executor is ready")
    rospy.on_shutdown(executor.shutdown)
    rospy.spin()

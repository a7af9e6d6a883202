"""Node: the state machines of an application's actions in one process."""

from typing import List

import rospy

from merlin_actions.action_interface import wait_for_knowledge_base
from merlin_actions.merlin_action_server import MerlinActionServer
from merlin_actions.merlin_action_sm import MerlinActionSM
from merlin_actions.names import by_ros_name, load_class
from merlin_sm.health import HealthReporter
from merlin_sm.knowledge_client import DEFAULT_KNOWLEDGE_BASE, KnowledgeError, knowledge_client
from merlin_sm.node import run_node
from merlin_sm.parameters import number


def make_servers(paths: List[str], knowledge_base: str) -> List[MerlinActionServer]:
    """Makes the servers of the given classes and compares each with its operator.

    :param paths: ``package.module:Class`` each.
    :raises ValueError: for a path without a fitting class, an unknown operator or different parameters.
    """
    operators = knowledge_client(knowledge_base).operators()
    servers = []
    for path in paths:
        action_class = load_class(path)
        if not issubclass(action_class, MerlinActionSM):
            raise ValueError(f"{path} is no MerlinActionSM")
        machine = action_class()
        name = machine.operator_name()
        if name not in operators:
            raise ValueError(
                f"{path}: the domain has no operator {name!r}, only {', '.join(operators) or 'none'}"
            )
        machine.check_signature([parameter.key for parameter in operators[name].typed_parameters])
        servers.append(MerlinActionServer(machine))
    by_ros_name(server.operator for server in servers)
    return servers


def main() -> int:
    """Runs the node; returns the exit code."""
    return run_node("merlin_fsm_host", _start, KnowledgeError, ValueError, rospy.ServiceException)


def _start() -> None:
    knowledge_base = rospy.get_param("~knowledge_base", DEFAULT_KNOWLEDGE_BASE)
    paths = rospy.get_param("~actions", [])
    if not isinstance(paths, list) or not paths:
        raise ValueError(
            f"parameter {rospy.resolve_name('~actions')} has to be a list of package.module:Class"
        )
    wait_for_knowledge_base(knowledge_base, number("~knowledge_base_wait", 30.0, 0.0))
    servers = make_servers(paths, knowledge_base)
    for server in servers:
        server.start()
        rospy.on_shutdown(server.shutdown)
    HealthReporter({server.operator: server.health for server in servers}).start()
    rospy.loginfo(f"serving the actions {', '.join(server.operator for server in servers)}")

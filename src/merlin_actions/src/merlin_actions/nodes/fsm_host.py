"""Node: the state machines of an application's actions in one process."""

import math
from typing import List

import rospy

from merlin_actions.action_classes import read_machines
from merlin_actions.action_interface import wait_for_knowledge_base
from merlin_actions.core.application_check import ApplicationError, World, check_application
from merlin_actions.core.names import by_ros_name
from merlin_actions.machine_survey import survey
from merlin_actions.merlin_action_server import CANCEL_LIMIT, MerlinActionServer
from merlin_actions.merlin_action_sm import MerlinActionSM
from merlin_ros.health import HealthReporter
from merlin_ros.master.master_link import get_param
from merlin_ros.node import keep_params, on_master_lost, run_node
from merlin_ros.parameters import number
from merlin_sm.knowledge_client import (
    DEFAULT_KNOWLEDGE_BASE,
    KnowledgeBaseMissing,
    KnowledgeError,
    knowledge_client,
)
from merlin_sm.states.navigation import POINTS_PARAM


def check_machines(machines: List[MerlinActionSM], knowledge_base: str, complete: bool) -> None:
    """Compares machines with domain, objects and points of interest.

    :param complete: every operator has to have a class.
    :raises ApplicationError: when they do not fit; it names all mistakes.
    """
    client = knowledge_client(knowledge_base)
    operators = {
        name: [(parameter.key, parameter.value) for parameter in formula.typed_parameters]
        for name, formula in client.operators().items()
    }
    world = World(operators, client.instances, list(get_param(POINTS_PARAM, {})))
    mistakes = check_application([survey(machine) for machine in machines], world, complete)
    if mistakes:
        raise ApplicationError(mistakes)


def make_servers(machines: List[MerlinActionSM]) -> List[MerlinActionServer]:
    """Makes the servers of machines.

    :raises ValueError: when two operators map to one name.
    """
    by_ros_name(machine.operator_name() for machine in machines)
    cancel_limit = number("~cancel_limit", CANCEL_LIMIT, -math.inf)
    return [MerlinActionServer(machine, cancel_limit) for machine in machines]


def main() -> int:
    """Runs the node; returns the exit code."""
    missing = (KnowledgeBaseMissing, rospy.ServiceException)
    return run_node("merlin_fsm_host", _start, KnowledgeError, ValueError, missing=missing)


def _start() -> None:
    knowledge_base = rospy.get_param("~knowledge_base", DEFAULT_KNOWLEDGE_BASE)
    machines = read_machines()
    wait_for_knowledge_base(knowledge_base, number("~knowledge_base_wait", 30.0, 0.0))
    check_machines(machines, knowledge_base, bool(rospy.get_param("~complete", False)))
    servers = make_servers(machines)
    for server in servers:
        server.start()
        rospy.on_shutdown(server.shutdown)
        on_master_lost(server.master_lost)
    keep_params(rospy.resolve_name("actions"))  # what the machines declare to their bridges
    HealthReporter({server.operator: server.health for server in servers}).start()
    rospy.loginfo(f"serving the actions {', '.join(server.operator for server in servers)}")

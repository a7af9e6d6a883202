# SPDX-License-Identifier: Apache-2.0
"""Node: the state machines of an application's actions in one process."""

import math
import threading
from typing import Dict, List, Mapping, Optional, Tuple

import rospy
from rosplan_knowledge_msgs.msg import DomainFormula
from std_srvs.srv import Trigger, TriggerRequest, TriggerResponse

from merlin_actions.action_classes import read_machines
from merlin_actions.core.application_check import ApplicationError, ApplicationWorld, check_application
from merlin_actions.core.application_modules import ApplicationModules
from merlin_actions.core.declared import declared_fault
from merlin_actions.core.names import by_ros_name
from merlin_actions.core.robot_check import check_robots, robot_parameters
from merlin_actions.machine_survey import fitted, survey
from merlin_actions.merlin_action_server import CANCEL_LIMIT, MerlinActionServer
from merlin_actions.merlin_action_sm import MerlinActionSM
from merlin_actions.robot_presence import RobotPresence
from merlin_actions.shutdown_order import shut_down
from merlin_pddl.checks.literals import literal_fault
from merlin_planning.knowledge_client import (
    DEFAULT_KNOWLEDGE_BASE,
    KnowledgeBaseMissing,
    KnowledgeError,
    knowledge_client,
    known_domain,
    wait_for_knowledge_base,
)
from merlin_ros.health import HealthReporter
from merlin_ros.master.master_link import get_param
from merlin_ros.node import keep_params, on_master_lost, run_node
from merlin_ros.parameters import flag, graph_name, number
from merlin_sm.holding.node_holds import node_holds, usual_level
from merlin_sm.state_factory import MerlinStateFactory
from merlin_sm.states.action_state import end_unused_clients
from merlin_sm.states.navigation import POINTS_PARAM, point_faults


def read_world(knowledge_base: str) -> ApplicationWorld:
    """Domain, objects and points of interest, of a knowledge base and the parameter server."""
    client = knowledge_client(knowledge_base)
    known = known_domain(client)
    return ApplicationWorld(
        _signatures(client.operators()),
        client.instances,
        list(get_param(POINTS_PARAM, {})),
        None,
        client.types(),
        _signatures({**client.function_signatures(), **client.predicates()}),
        lambda text, operator: declared_fault(text, operator, *known) if known else "",
        lambda text, operator, adds: literal_fault(text, *known, operator, adds) if known else "",
    )


def _signatures(formulas: Mapping[str, DomainFormula]) -> Dict[str, List[Tuple[str, str]]]:
    return {
        name: [(parameter.key, parameter.value) for parameter in formula.typed_parameters]
        for name, formula in formulas.items()
    }


def check_machines(
    machines: List[MerlinActionSM], world: ApplicationWorld, complete: bool, robot: str = ""
) -> Dict[str, str]:
    """Compares machines with domain, objects and points of interest.

    :param complete: every operator has to have a class.
    :param robot: that this host serves; empty: the only robot, which has no name.
    :return: operator -> the variable that names its robot, for those that need one.
    :raises ApplicationError: when they do not fit; it names all mistakes.
    """
    needs = [survey(machine) for machine in machines]
    mistakes = check_application(needs, world, complete)
    mistakes += check_robots(needs, world, [robot] if robot else [])
    mistakes += point_faults(get_param(POINTS_PARAM, {}))
    if mistakes:
        raise ApplicationError(mistakes)
    return robot_parameters(needs, world)


def make_servers(machines: List[MerlinActionSM]) -> List[MerlinActionServer]:
    """Makes the servers of machines.

    :raises ValueError: when two operators map to one name.
    """
    by_ros_name(machine.operator_name() for machine in machines)
    cancel_limit = number("~cancel_limit", CANCEL_LIMIT, -math.inf)
    return [MerlinActionServer(machine, cancel_limit) for machine in machines]


class MachineHost:
    """The machines of an application and their servers.

    With several robots each has a host, ``~robot``, that serves the actions with a parameter that names a
    robot; one more, ``~robots``, serves the others.

    :raises ValueError: when a class or a parameter is wrong.
    :raises KnowledgeBaseMissing: when there is no knowledge base in time.
    """

    def __init__(self) -> None:
        self._modules = ApplicationModules()
        self._reloading = threading.Lock()  # one reload after the other
        self._knowledge_base = graph_name("~knowledge_base", DEFAULT_KNOWLEDGE_BASE)
        self._robot = str(rospy.get_param("~robot", ""))
        self._robots = flag("~robots") or bool(self._robot)
        self._presence: Optional[RobotPresence] = None
        machines = read_machines()
        self._modules.note()
        wait_for_knowledge_base(self._knowledge_base, number("~knowledge_base_wait", 30.0, 0.0))
        machines, variables = self._fit(machines)
        if self._robots:  # a look through the whole process
            end_unused_clients()  # of the machines that other hosts serve
        if self._robot:
            name = rospy.resolve_name(self._knowledge_base)
            self._presence = RobotPresence(self._robot, name, variables)
            self._presence.refuse_second()
        self.servers = make_servers(machines)

    def start(self) -> None:
        """Begins to serve."""
        node_holds.offer()
        started: List[MerlinActionServer] = []
        rospy.on_shutdown(lambda: shut_down(started))
        for server in self.servers:
            server.start()
            started.append(server)
            on_master_lost(server.master_lost)
        rospy.Service("~reload_actions", Trigger, self._serve_reload)
        if self._presence is not None:
            rospy.on_shutdown(self._presence.shutdown)
            self._presence.start()

    def reload(self) -> str:
        """Imports the edited classes; goals that run end with the machines they began with.

        :return: what was done.
        :raises Exception: when a class is wrong; everything is as before then.
        """
        with self._reloading:
            edited = self._modules.edited()
            with self._modules.renewed(), MerlinStateFactory.renewed():
                own, _ = self._fit(read_machines())
                machines = {machine.operator_name(): machine for machine in own}
                served = {server.operator for server in self.servers}
                if set(machines) != served:
                    raise ValueError(
                        f"the classes are for {', '.join(sorted(machines))}, but {', '.join(sorted(served))} "
                        "are served; another operator needs a new start of the launch"
                    )
            self._modules.note()
            running = [server.operator for server in self.servers if server.renew(machines[server.operator])]
            end_unused_clients()  # of the classes before
        done = f"reloaded {', '.join(sorted(machines))}" if machines else "the robots have all actions"
        said = f"{done}; edited: {', '.join(edited) or 'nothing'}"
        if running:
            said += f"; {', '.join(running)} runs, and is the edited one from its next run on"
        return said

    def _fit(self, machines: List[MerlinActionSM]) -> Tuple[List[MerlinActionSM], Dict[str, str]]:
        """Those that this host serves, for its domain; and operator -> the variable that names its robot."""
        world = read_world(self._knowledge_base)
        machines = [fitted(machine, world) for machine in machines]
        complete = flag("~complete")
        robots = check_machines(machines, world, complete, self._robot)
        if self._robots:
            machines = [each for each in machines if (each.operator_name() in robots) == bool(self._robot)]
        return machines, robots

    def _serve_reload(self, _: TriggerRequest) -> TriggerResponse:
        try:
            said = self.reload()
        except Exception as error:  # users' code may raise anything; the caller gets it as a text
            rospy.logwarn(f"the actions stay as they were: {error}")
            return TriggerResponse(False, str(error) or type(error).__name__)
        rospy.loginfo(said)
        return TriggerResponse(True, said)


def main() -> int:
    """Runs the node; returns the exit code."""
    missing = (KnowledgeBaseMissing, rospy.ServiceException)
    return run_node("merlin_fsm_host", _start, KnowledgeError, ValueError, missing=missing)


def _start() -> None:
    usual_level()  # a wrong one is reported before the wait for the knowledge base
    host = MachineHost()
    host.start()
    keep_params(rospy.resolve_name("actions"))  # what the machines declare to their bridges
    HealthReporter({server.operator: server.health for server in host.servers}).start()
    rospy.loginfo(f"serving the actions {', '.join(server.operator for server in host.servers)}")

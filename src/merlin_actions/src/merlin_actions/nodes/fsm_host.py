"""Node: the state machines of an application's actions in one process."""

import math
import threading
from typing import List

import rospy
from std_srvs.srv import Trigger, TriggerRequest, TriggerResponse

from merlin_actions.action_classes import read_machines
from merlin_actions.action_interface import wait_for_knowledge_base
from merlin_actions.core.application_check import ApplicationError, ApplicationWorld, check_application
from merlin_actions.core.application_modules import ApplicationModules
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
from merlin_sm.state_factory import MerlinStateFactory
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
    world = ApplicationWorld(operators, client.instances, list(get_param(POINTS_PARAM, {})))
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


class MachineHost:
    """The machines of an application and their servers.

    :raises ValueError: when a class or a parameter is wrong.
    :raises KnowledgeBaseMissing: when there is no knowledge base in time.
    """

    def __init__(self) -> None:
        self._modules = ApplicationModules()
        self._reloading = threading.Lock()  # one reload after the other
        self._knowledge_base = rospy.get_param("~knowledge_base", DEFAULT_KNOWLEDGE_BASE)
        machines = read_machines()
        self._modules.note()
        wait_for_knowledge_base(self._knowledge_base, number("~knowledge_base_wait", 30.0, 0.0))
        self._check(machines)
        self.servers = make_servers(machines)

    def start(self) -> None:
        """Begins to serve."""
        for server in self.servers:
            server.start()
            rospy.on_shutdown(server.shutdown)
            on_master_lost(server.master_lost)
        rospy.Service("~reload_actions", Trigger, self._serve_reload)

    def reload(self) -> str:
        """Imports the edited classes; goals that run end with the machines they began with.

        :return: what was done.
        :raises Exception: when a class is wrong; everything is as before then.
        """
        with self._reloading:
            edited = self._modules.edited()
            with self._modules.renewed(), MerlinStateFactory.renewed():
                machines = {machine.operator_name(): machine for machine in read_machines()}
                self._check(list(machines.values()))
                served = {server.operator for server in self.servers}
                if set(machines) != served:
                    raise ValueError(
                        f"the classes are for {', '.join(sorted(machines))}, but {', '.join(sorted(served))} "
                        "are served; another operator needs a new start of the launch"
                    )
            self._modules.note()
            running = [server.operator for server in self.servers if server.renew(machines[server.operator])]
        said = f"reloaded {', '.join(sorted(machines))}; edited: {', '.join(edited) or 'nothing'}"
        if running:
            said += f"; {', '.join(running)} runs, and is the edited one from its next run on"
        return said

    def _check(self, machines: List[MerlinActionSM]) -> None:
        check_machines(machines, self._knowledge_base, bool(rospy.get_param("~complete", False)))

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
    host = MachineHost()
    host.start()
    keep_params(rospy.resolve_name("actions"))  # what the machines declare to their bridges
    HealthReporter({server.operator: server.health for server in host.servers}).start()
    rospy.loginfo(f"serving the actions {', '.join(server.operator for server in host.servers)}")

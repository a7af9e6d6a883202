# SPDX-License-Identifier: Apache-2.0
"""The action servers of one operator: in this namespace, or each robot's in its own."""

import threading
from typing import Dict, Mapping, Optional

import rospy
from merlin_msgs.msg import RunActionAction
from rosplan_knowledge_msgs.msg import DomainFormula

from merlin_actions.core.names import action_param
from merlin_actions.core.robot_parameter import robot_parameter
from merlin_actions.robot_watch import RobotWatch
from merlin_ros.actions.action_client import ActionClient
from merlin_ros.health import ERROR, Health


class ActionServers:
    """Finds the server for an execution.

    :param formula: name and parameters of the operator.
    :param parents: types of the domain -> their parents.
    :param robots: the robots that run; None: every action runs in this namespace.
    """

    def __init__(
        self, formula: DomainFormula, parents: Mapping[str, str], robots: Optional[RobotWatch]
    ) -> None:
        self._operator = formula.name
        self._robots = robots
        parameters = [(entry.key, entry.value) for entry in formula.typed_parameters]
        try:
            self._by_type = robot_parameter(formula.name, parameters, parents)
        except ValueError:
            self._by_type = ""  # the hosts of the robots have to say it
        self._lock = threading.Lock()  # guards the fields below
        self._clients: Dict[str, ActionClient] = {}  # by name of the action
        self._names: Dict[str, str] = {}  # robot -> name of its action
        if not self.parameter:
            self.client()

    @property
    def parameter(self) -> str:
        """The variable that names the robot; empty: the operator needs none."""
        if self._robots is None:
            return ""
        return self._robots.parameter(self._operator) or self._by_type

    def robot(self, binding: Mapping[str, str]) -> str:
        """The robot that runs an execution; empty: it needs none.

        :param binding: variable -> object.
        """
        return binding.get(self.parameter, "") if self.parameter else ""

    def param(self, robot: str = "") -> str:
        """Name of the parameters and of the action, in the namespace of the robot."""
        namespace = self._robots.namespace(robot) if robot and self._robots is not None else ""
        return namespace + action_param(self._operator)

    def client(self, robot: str = "") -> ActionClient:
        """The client of the server, one for each."""
        name = rospy.resolve_name(self.param(robot))
        with self._lock:
            if name not in self._clients:
                self._clients[name] = ActionClient(name, RunActionAction)
            self._names[robot] = name
            return self._clients[name]

    def forget(self, robot: str) -> None:
        """Shuts the client of a robot down that is forgotten."""
        with self._lock:
            name = self._names.pop(robot, "")
            client = None if name in self._names.values() else self._clients.pop(name, None)
        if client is not None:
            client.shutdown()

    @property
    def robots(self) -> RobotWatch:
        """The robots that run; there are some where a robot runs an execution."""
        assert self._robots is not None
        return self._robots

    def health(self) -> Health:
        """Whether the servers answer."""
        if self.parameter:
            return Health()  # robots come and go; the bridges report which of them run
        client = self.client()
        if client.alive:
            return Health()
        return Health(ERROR, f"no action server {client.name}; does the host of its machine run?")

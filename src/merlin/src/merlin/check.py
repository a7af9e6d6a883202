"""The command `rosrun merlin check`: whether the parts of an application fit, before anything is started."""

import os
import sys
from typing import Dict, List, Tuple

import rospy
from roslaunch.core import Node

from merlin.launch_config import LaunchConfig
from merlin.launch_request import LaunchError, LaunchRequest
from merlin.master import Master
from merlin_actions.action_classes import make_machines
from merlin_actions.core.application_check import ApplicationError, ApplicationWorld, check_application
from merlin_actions.machine_survey import survey
from merlin_pddl.domain import Domain
from merlin_pddl.domain_reader import read_domain
from merlin_pddl.problem import Problem
from merlin_pddl.problem_reader import read_problem
from merlin_pddl.text_reader import PddlError
from merlin_ros.node import init_node

MISSION = "mission"
EXIT_MISTAKES = 2


def main() -> int:
    """Checks the application of a launch file; returns the exit code, 2 when something is wrong."""
    try:
        request = LaunchRequest.from_command_line(sys.argv[1:])
        config = LaunchConfig(request)
    except LaunchError as error:
        print(f"merlin check: {error}", file=sys.stderr)
        return EXIT_MISTAKES
    master = Master()  # states announce themselves to one
    os.environ["ROS_MASTER_URI"] = f"http://localhost:{master.port}"
    sys.argv[1:] = []  # the arguments are not those of a node
    init_node("merlin_check", anonymous=True)
    try:
        return _report(request.launch_file.name, config)
    finally:
        rospy.signal_shutdown("checked")
        master.stop()


def _report(name: str, config: LaunchConfig) -> int:
    """Checks each host of actions and prints what was found; returns the exit code."""
    try:
        hosts = list(config.hosts())
        if not hosts:
            raise LaunchError(
                "it starts no actions; include actions.launch, robot.launch or application.launch"
            )
        for namespace, host in hosts:
            print(f"{name}: {check_host(config, namespace, host)}")
    except ApplicationError as error:
        for mistake in error.mistakes:
            print(f"{name}: {mistake}", file=sys.stderr)
        return EXIT_MISTAKES
    except (LaunchError, PddlError) as error:
        print(f"{name}: {error}", file=sys.stderr)
        return EXIT_MISTAKES
    if not any(node.name == MISSION for node in config.nodes):
        print(f"{name}: no node is named 'mission': it runs until it is ended, and sends no goals itself")
    return 0


def check_host(config: LaunchConfig, namespace: str, host: Node) -> str:
    """Checks the actions of one host; returns a sentence about what fits.

    :raises ApplicationError: when something does not fit.
    :raises LaunchError: when domain or problem are missing.
    :raises PddlError: when one of them is not PDDL.
    """
    prefix = f"{namespace}rosplan_knowledge_base"
    domain = read_domain(config.file(f"{prefix}/domain_path"))
    problem = Problem("", domain.name)
    if config.param(f"{prefix}/problem_path"):
        problem = read_problem(config.file(f"{prefix}/problem_path"), domain)
    own = f"{namespace}{host.name}"
    paths = config.param(f"{own}/actions", [])
    if not isinstance(paths, list) or not all(isinstance(path, str) for path in paths):
        raise LaunchError(f"parameter {own}/actions has to be a list of package.module:Class")
    machines = make_machines(paths)
    operators: Dict[str, List[Tuple[str, str]]] = {
        operator.name: [(variable.label, variable.types[0]) for variable in operator.parameters]
        for operator in domain.operators.values()
    }
    points = list(config.param(f"{namespace}world/points_of_interest", {}))
    served = config.servers(namespace)
    world = ApplicationWorld(
        operators,
        lambda kind: _objects(domain, problem, kind),
        points,
        list(served) if config.has_robot else None,
    )
    needs = [survey(machine) for machine in machines]
    mistakes = check_application(needs, world, bool(config.param(f"{own}/complete", False)))
    if mistakes:
        raise ApplicationError(mistakes)
    wanted = sorted({server for need in needs for _, server in need.servers})
    there = "" if config.has_robot else ", which the robot has to serve"
    return (
        f"{len(operators)} operators, {len(machines)} classes, {len(points)} points of interest fit; "
        f"servers: {', '.join(wanted) or 'none'}{there}"
    )


def _objects(domain: Domain, problem: Problem, kind: str) -> List[str]:
    known = {**domain.constants, **problem.objects}
    return [name for name, types in known.items() if any(domain.types.is_a(own, kind) for own in types)]

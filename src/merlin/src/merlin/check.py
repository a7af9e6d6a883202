"""The command `rosrun merlin check`: whether the parts of an application fit, before anything is started."""

import os
import sys
from typing import Dict, List, Mapping, Tuple

import rospy
from rosgraph.names import load_mappings
from roslaunch.core import Node

from merlin.launch_config import LaunchConfig
from merlin.launch_request import HelpWanted, LaunchError, LaunchRequest
from merlin.local_names import master_uri, use_loopback
from merlin.master import Master
from merlin_actions.action_classes import make_machines
from merlin_actions.core.application_check import ApplicationError, ApplicationWorld, check_application
from merlin_actions.core.declared import declared_fault
from merlin_actions.core.robot_check import check_robots, robot_parameters, unnamed_robots
from merlin_actions.machine_survey import fitted, survey
from merlin_executor.mission.mission_host import load_mission
from merlin_executor.mission.readiness import servers_of
from merlin_pddl.checks.portability import declared_twice
from merlin_pddl.domain import Domain, Signature
from merlin_pddl.domain_reader import read_domain
from merlin_pddl.problem import Problem
from merlin_pddl.problem_reader import read_problem
from merlin_pddl.text_reader import PddlError
from merlin_ros.node import init_node

MISSION = "mission"
MISSION_NODE = ("merlin_executor", "mission")
EXIT_MISTAKES = 2


def main() -> int:
    """Checks the application of a launch file; returns the exit code, 2 when something is wrong."""
    try:
        request = LaunchRequest.from_command_line(sys.argv[1:])
        config = LaunchConfig(request)
    except HelpWanted as asked:
        print(f"usage: rosrun merlin check {asked}")
        return 0
    except LaunchError as error:
        print(f"merlin check: {error}", file=sys.stderr)
        return EXIT_MISTAKES
    use_loopback()
    master = Master()  # states announce themselves to one
    os.environ["ROS_MASTER_URI"] = master_uri(master.port)
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
        mistakes: Dict[str, List[str]] = {}  # mistake → the robots of the hosts that have it
        for namespace, host in hosts:
            try:
                print(f"{name}: {check_host(config, namespace, host)}")
            except ApplicationError as error:
                robot = str(config.param(f"{namespace}{host.name}/robot", ""))
                for mistake in error.mistakes:
                    mistakes.setdefault(mistake, []).append(robot)
        for mistake, robots in mistakes.items():
            whose = "" if "" in robots else f"robot {' and '.join(robots)}: "
            print(f"{name}: {whose}{mistake}", file=sys.stderr)
        if mistakes:
            return EXIT_MISTAKES
        check_missions(config)
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
    prefix = config.knowledge_base(host)
    domain = read_domain(config.file(f"{prefix}/domain_path"))
    problem = Problem("", domain.name)
    if config.param(f"{prefix}/problem_path"):
        file = config.file(f"{prefix}/problem_path")
        problem = read_problem(file, domain)
        for warning in declared_twice(file.read_text(encoding="utf-8-sig"), str(file)):
            print(warning)
    own = f"{namespace}{host.name}"
    paths = config.param(f"{own}/actions", [])
    if not isinstance(paths, list) or not all(isinstance(path, str) for path in paths):
        raise LaunchError(f"parameter {own}/actions has to be a list of package.module:Class")
    machines = make_machines(paths)
    robot = str(config.param(f"{own}/robot", ""))
    robots = config.robots()
    points = list(config.param(f"{namespace}world/points_of_interest", {}))
    served = config.servers(namespace)
    world = ApplicationWorld(
        _signatures(domain.operators),
        lambda kind: _objects(domain, problem, kind),
        points,
        list(served) if config.has_robot else None,
        {name: next(iter(domain.types.parents(name)), "") for name in domain.types},
        _signatures({**domain.functions, **domain.predicates}),
        lambda text, operator: declared_fault(text, operator, domain, problem.objects),
    )
    everything = [survey(fitted(machine, world)) for machine in machines]
    bound = robot_parameters(everything, world) if robots else {}
    # With several robots a host serves the actions that name one, or the others.
    needs = [need for need in everything if not robots or (need.operator in bound) == bool(robot)]
    elsewhere = [need._replace(points=(), targets=(), servers=()) for need in everything if need not in needs]
    mistakes = check_application([*needs, *elsewhere], world, bool(config.param(f"{own}/complete", False)))
    mistakes += check_robots(everything, world, robots)
    if not robots:
        mistakes += unnamed_robots(domain, problem)
    if mistakes:
        raise ApplicationError(mistakes)
    wanted = sorted({server for need in needs for _, server in need.servers})
    there = "" if config.has_robot else ", which the robot has to serve"
    return (
        f"{f'robot {robot}: ' if robot else ''}"
        f"{len(domain.operators)} operators, {len(needs)} classes, {len(points)} points of interest fit; "
        f"servers: {', '.join(wanted) or 'none'}{there}"
    )


def check_missions(config: LaunchConfig) -> None:
    """Loads the class of each mission.

    :raises LaunchError: when one does not exist, is not a mission, or waits for a server that is not started.
    """
    for node in config.nodes:
        if (node.package, node.type) != MISSION_NODE:
            continue
        own = f"{node.namespace}{node.name}"
        path = str(load_mappings(node.args.split()).get("mission") or config.param(f"{own}/mission", ""))
        try:
            servers = load_mission(path).servers
        except ValueError as error:
            raise LaunchError(f"node {own}: {error}; correct its mission:=package.module:Class") from error
        robots = config.robots()
        served = [
            below + name
            for below in ("", *(f"{robot}/" for robot in robots))
            for name in config.servers(node.namespace + below)
        ]
        wanted = servers_of(servers, robots)
        missing = [name for name in wanted if name not in served] if config.has_robot else []
        if missing:
            raise LaunchError(
                f"node {own}: {path} waits for the action servers {', '.join(missing)}, which the launch "
                f"file does not start; it starts: {', '.join(sorted(served)) or 'none'}"
            )


def _signatures(named: Mapping[str, Signature]) -> Dict[str, List[Tuple[str, str]]]:
    return {
        name: [(variable.label, variable.types[0]) for variable in signature.parameters]
        for name, signature in named.items()
    }


def _objects(domain: Domain, problem: Problem, kind: str) -> List[str]:
    known = {**domain.constants, **problem.objects}
    return [name for name, types in known.items() if any(domain.types.is_a(own, kind) for own in types)]

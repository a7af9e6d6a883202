# SPDX-License-Identifier: Apache-2.0
"""The command `rosrun merlin check`: whether the parts of an application fit, before anything is started."""

import os
import sys
from pathlib import Path
from typing import Any, Callable, Dict, List, Mapping, NamedTuple, Set, Tuple

from rosgraph.names import load_mappings
from roslaunch.core import Node

from merlin.launch_config import LaunchConfig, full_name
from merlin.launch_request import HelpWanted, LaunchError, LaunchRequest
from merlin.local_names import master_uri, use_loopback
from merlin.master import Master
from merlin_actions.action_classes import make_machines
from merlin_actions.core.application_check import (
    ApplicationError,
    ApplicationWorld,
    check_application,
    not_looked_at,
)
from merlin_actions.core.declared import declared_fault
from merlin_actions.core.robot_check import check_robots, robot_parameters, unnamed_robots
from merlin_actions.machine_survey import fitted, survey
from merlin_executor.mission.literal_goals import goal_faults
from merlin_executor.mission.mission_host import load_mission
from merlin_executor.mission.readiness import servers_of
from merlin_monitor.panel_board import foreign_panel, panel_paths, script_of
from merlin_monitor.panels.control import NONE, SENTENCES, GoalListError, read_goals
from merlin_monitor.text.sentences import SentencesError, domain_faults, read_sentences
from merlin_pddl.checks.literals import calls_of, literal_fault
from merlin_pddl.checks.portability import declared_twice, misspelt_supertypes
from merlin_pddl.checks.values import missing_values, open_durations
from merlin_pddl.domain import Domain, Signature
from merlin_pddl.domain_reader import parse_domain
from merlin_pddl.problem import Problem
from merlin_pddl.problem_reader import read_problem
from merlin_pddl.text_reader import PddlError, suggestion, text_of
from merlin_ros.class_path import WITHOUT_BASE, load_function
from merlin_ros.node import end_node, init_node
from merlin_ros.parameters import ParameterError
from merlin_ros.processes.process_priority import lower_priority
from merlin_sm.states.navigation import point_faults

MISSION = "mission"
MISSION_NODE = ("merlin_executor", "mission")
SIMULATOR_NODE = ("merlin_sim", "merlin_sim")
PAGE_NODE = ("merlin_monitor", "monitor")
#: Reads a world; the simulator is not on a robot's computer.
LOAD_WORLD = "merlin_sim.world.world_file:load_world"
PLACE_ROBOTS = "merlin_sim.node.robot_starts:place_robots"
EXIT_MISTAKES = 2


def main_at_start() -> int:
    """Says what no node of an application says that starts; in a process that its runner has started.

    :return: the exit code.
    """
    lower_priority(19)
    return main(at_start=True)


def main(at_start: bool = False) -> int:
    """Checks the application of a launch file; returns the exit code, 2 when something is wrong.

    :param at_start: it is started at the same time, and its nodes say the rest.
    """
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
        return report(f"{'merlin run: ' * at_start}{request.launch_file.name}", config, at_start)
    finally:
        end_node("checked")
        master.stop()


class Task(NamedTuple):
    """Domain and problem of a knowledge base."""

    domain: Domain
    problem: Problem

    def fault(self, text: str, operator: str = "", adds_objects: bool = False) -> str:
        """What is wrong with facts or goals, as :func:`merlin_pddl.checks.literals.literal_fault` says it."""
        return literal_fault(text, self.domain, self.problem.objects, operator, adds_objects)


class Findings:
    """What was found. Each sentence once, however many robots have it.

    :ivar mistakes: what has to be corrected, and the robots whose hosts have it; empty: no robot's own.
    :ivar unsaid: those of them that no node says when it starts.
    :ivar robot: whose host is looked at.
    :ivar fits: what fits, and what was not looked at.
    :ivar points_read: whether the points of interest were judged, with the world that they are in.
    """

    def __init__(self) -> None:
        self.mistakes: Dict[str, List[str]] = {}
        self.unsaid: Set[str] = set()
        self.robot = ""
        self.fits: Dict[str, None] = {}
        self.points_read = False
        self._tasks: Dict[str, Task] = {}

    def look(self, part: Callable[..., None], *arguments: Any) -> None:
        """Looks at a part; what it raises is a mistake, and the other parts are looked at too."""
        try:
            part(self, *arguments)
        except ApplicationError as error:
            self.wrong(*error.mistakes)
        except (LaunchError, PddlError, ValueError) as error:
            self.wrong(str(error))

    def wrong(self, *mistakes: str) -> None:
        """Notes mistakes."""
        for mistake in mistakes:
            self.mistakes.setdefault(mistake, []).append(self.robot)

    def task(self, config: LaunchConfig, name: str) -> Task:
        """Domain and problem of a knowledge base, which are read once.

        :raises LaunchError: when one of the files is missing.
        :raises PddlError: when one of them is not PDDL.
        """
        if name not in self._tasks:
            source = config.file(f"{name}/domain_path")
            text = text_of(source)
            self.fits.update(dict.fromkeys(misspelt_supertypes(text, str(source))))
            domain = parse_domain(text, str(source))
            unkept = [*open_durations(domain, at_start=False), *map(_timed, domain.timed_constraints)]
            self.fits.update(dict.fromkeys(f"{source}: warning: {each}" for each in unkept))
            problem = Problem("", domain.name)
            if config.param(f"{name}/problem_path"):
                file = config.file(f"{name}/problem_path")
                problem = read_problem(file, domain)
                warnings = declared_twice(text_of(file), str(file))
                warnings += [f"{file}: warning: {text}" for text in missing_values(domain, problem)]
                self.fits.update(dict.fromkeys(warnings))
            self._tasks[name] = Task(domain, problem)
        return self._tasks[name]


def _timed(constraint: str) -> str:
    return f"{constraint}: a plan keeps its times as far as actions last as planned; the dispatch does not"


def report(name: str, config: LaunchConfig, at_start: bool = False) -> int:
    """Looks at all parts and prints what was found; returns the exit code.

    :param name: of the launch file, with which each line begins.
    :param at_start: only warnings, and mistakes that no node says when it starts.
    """
    found = Findings()
    hosts = list(config.hosts())
    if not hosts:
        found.wrong("it starts no actions; include actions.launch, robot.launch or application.launch")
    for kind, part in PARTS.items():
        for node in config.nodes:
            if (node.package, node.type) == kind:
                found.look(part, config, node)
    for namespace, host in hosts:
        found.robot = str(config.param(f"{namespace}{host.name}/robot", ""))
        found.look(check_host, config, namespace, host)
    for line in found.fits:
        if ": warning: " in line:
            print(line, file=sys.stderr if at_start else sys.stdout)
        elif not at_start:
            print(f"{name}: {line}")
    for mistake, robots in found.mistakes.items():
        if at_start and mistake not in found.unsaid:
            continue
        whose = "" if "" in robots else f"robot {' and '.join(dict.fromkeys(robots))}: "
        print(f"{name}: {whose}{mistake}", file=sys.stderr)
    if found.mistakes:
        return EXIT_MISTAKES
    if not at_start and not any(node.name == MISSION for node in config.nodes):
        print(f"{name}: no node is named 'mission': it runs until it is ended, and sends no goals itself")
    return 0


def check_host(found: Findings, config: LaunchConfig, namespace: str, host: Node) -> None:
    """Compares the actions of one host with domain, problem, points of interest and servers.

    :raises ApplicationError: when something does not fit.
    :raises LaunchError: when domain or problem are missing.
    :raises PddlError: when one of them is not PDDL.
    """
    task = found.task(config, config.knowledge_base(host))
    domain, problem = task
    own = f"{namespace}{host.name}"
    paths = config.param(f"{own}/actions", [])
    if not isinstance(paths, list) or not all(isinstance(path, str) for path in paths):
        raise LaunchError(f"parameter {own}/actions has to be a list of package.module:Class")
    given = config.param(f"{namespace}world/points_of_interest", {})
    if not found.points_read:
        found.wrong(*point_faults(given))
    points = list(given) if isinstance(given, dict) else []
    machines = make_machines(paths)
    robot = str(config.param(f"{own}/robot", ""))
    robots = config.robots()
    served = config.servers(namespace)
    world = ApplicationWorld(
        _signatures(domain.operators),
        lambda kind: _objects(domain, problem, kind),
        points,
        list(served) if config.has_robot else None,
        {name: next(iter(domain.types.parents(name)), "") for name in domain.types},
        _signatures({**domain.functions, **domain.predicates}),
        lambda text, operator: declared_fault(text, operator, domain, problem.objects),
        task.fault,
        config.strangers,
        config.judges(namespace),
    )
    everything = [survey(fitted(machine, world)) for machine in machines]
    bound = robot_parameters(everything, world) if robots else {}
    # With several robots a host serves the actions that name one, or the others.
    needs = [need for need in everything if not robots or (need.operator in bound) == bool(robot)]
    elsewhere = [
        need._replace(points=(), targets=(), servers=(), asked=(), services=())
        for need in everything
        if need not in needs
    ]
    complete = bool(config.param(f"{own}/complete", False))
    mistakes = check_application([*needs, *elsewhere], world, complete)
    said_by_host = check_application([*needs, *elsewhere], world._replace(servers=None, known={}), complete)
    found.unsaid.update(set(mistakes).difference(said_by_host))
    mistakes += check_robots(everything, world, robots)
    refused = open_durations(domain, at_start=True)
    found.unsaid.update(refused)
    mistakes += refused
    if not robots:
        mistakes += unnamed_robots(domain, problem)
    if mistakes:
        raise ApplicationError(mistakes)
    wanted = sorted({server for need in needs for _, server in need.servers})
    there = "" if config.has_robot else ", which the robot has to serve"
    if needs or not robots:  # of several robots each host has those of its own
        found.fits[
            f"{f'robot {robot}: ' if robot else ''}"
            f"{len(domain.operators)} operators, {len(needs)} classes, {len(points)} points of interest fit; "
            f"servers: {', '.join(wanted) or 'none'}{there}"
        ] = None
    found.fits.update(dict.fromkeys(f"not looked at: {text}" for text in not_looked_at(needs, world)))


def check_mission(found: Findings, config: LaunchConfig, node: Node) -> None:
    """Loads the class of a mission, and reads the goals that stand in it.

    :raises LaunchError: when it does not exist, is not a mission, or waits for a server that is not started.
    """
    own = full_name(node)
    path = str(load_mappings(node.args.split()).get("mission") or config.param(f"{own}/mission", ""))
    try:
        mission = load_mission(path)
    except ValueError as error:
        raise LaunchError(f"node {own}: {error}; correct its mission:=package.module:Class") from error
    if "__init__" in vars(mission) and not calls_of(mission, "__init__", mission.__mro__[1:]):
        found.wrong(f"node {own}: {path} cannot be made: {WITHOUT_BASE}")
    robots = config.robots()
    served = [
        below + name
        for below in ("", *(f"{robot}/" for robot in robots))
        for name in config.servers(node.namespace + below)
    ]
    wanted = servers_of(mission.servers, robots)
    missing = [name for name in wanted if name not in served] if config.has_robot else []
    waits = f"node {own}: {path} waits for the action servers {', '.join(missing)}, which"
    if missing and config.strangers:
        found.fits[f"not looked at: {waits} {' or '.join(config.strangers)} has to serve"] = None
    elif missing:
        found.wrong(
            f"{waits} the launch file does not start; it starts: {', '.join(sorted(served)) or 'none'}"
        )
    fault = found.task(config, config.knowledge_base(node)).fault
    found.wrong(
        *goal_faults(mission, fault), *mission.faults(lambda key: config.param(f"{own}/{key}"), fault)
    )


def check_world(found: Findings, config: LaunchConfig, node: Node) -> None:
    """Reads the world of the simulator, and places the robots in it, as it does itself.

    :raises ValueError: when it cannot be used; the text names the file, or the robot without a place.
    """
    own = full_name(node)
    try:
        world = load_function(LOAD_WORLD)(config.file(f"{own}/world"))
    except Exception as error:  # WorldError, of a package that is loaded here
        found.points_read = True
        raise ValueError(str(error)) from error
    try:
        load_function(PLACE_ROBOTS)(config.param(f"{own}/robots", [""]), world)
    except ParameterError as error:
        raise ValueError(f"node {own}: {error}") from error


def check_page(found: Findings, config: LaunchConfig, node: Node) -> None:
    """Judges the port of the page, loads its panels, and reads its sentences, and the goals that it offers.

    :raises LaunchError: for a list of goals that cannot be read.
    """
    own = full_name(node)
    port = config.param(f"{own}/port", 0)
    if port not in range(65536):
        found.wrong(f"parameter {own}/port is {port!r}, not a whole number from 0 to 65535")
    found.look(_check_panels, config.param(f"{own}/panels", []))
    sentences = str(config.param(f"{node.namespace}{SENTENCES}", ""))
    if sentences not in ("", NONE):
        found.look(_check_sentences, Path(sentences).expanduser(), config, node)
    file = str(config.param(f"{own}/goals", ""))
    if file in ("", NONE):
        return
    try:
        offered = read_goals(Path(file).expanduser())
    except GoalListError as error:
        raise LaunchError(str(error)) from error
    task = found.task(config, config.knowledge_base(node))
    for goal in offered:
        fault = task.fault(goal.goal)
        if fault:
            mistake = f"the list of goals {file}: {goal.goal} ({goal.name}): {fault}; correct it"
            found.unsaid.add(mistake)
            found.wrong(mistake)


def _check_sentences(found: Findings, file: Path, config: LaunchConfig, node: Node) -> None:
    try:
        sentences = read_sentences(file)
    except SentencesError as error:
        found.wrong(*error.faults)
        return
    domain, problem = found.task(config, config.knowledge_base(node))
    signatures = {
        "operators": _signatures(domain.operators),
        "predicates": _signatures(domain.predicates),
        "functions": _signatures(domain.functions),
    }
    found.wrong(*domain_faults(sentences, signatures))
    known = {*domain.constants, *problem.objects, *sentences.optional}
    for name in sentences.objects:
        if name not in known:
            hint = suggestion(name, known)
            found.fits[
                f"{sentences.file}, objects.{name}: warning: the problem has no object '{name}'{hint}"
            ] = None


def _check_panels(found: Findings, value: Any) -> None:
    try:
        paths = panel_paths(value)
    except ParameterError as error:
        raise LaunchError(f"{error}; correct the launch file's 'panels'") from error
    for path in paths:
        found.look(_check_panel, path)


def _check_panel(_: Findings, path: str) -> None:
    try:
        script_of(foreign_panel(path))
    except ParameterError as error:
        raise LaunchError(f"{error}; correct the launch file's 'panels'") from error


#: Executable → what looks at its part of the application.
PARTS: Mapping[Tuple[str, str], Callable[..., None]] = {
    MISSION_NODE: check_mission,
    SIMULATOR_NODE: check_world,
    PAGE_NODE: check_page,
}


def _signatures(named: Mapping[str, Signature]) -> Dict[str, List[Tuple[str, str]]]:
    return {
        name: [(variable.label, variable.types[0]) for variable in signature.parameters]
        for name, signature in named.items()
    }


def _objects(domain: Domain, problem: Problem, kind: str) -> List[str]:
    known = problem.typed(domain.constants)
    return [name for name, types in known.items() if domain.accepts((kind,), types)]

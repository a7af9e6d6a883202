# SPDX-License-Identifier: Apache-2.0
"""Whether an application fits its robots. Without ROS; one sentence for each mistake."""

from typing import Dict, Iterator, List, Sequence

from merlin_actions.core.application_check import ApplicationWorld, Needs
from merlin_actions.core.robot_parameter import robot_parameter
from merlin_pddl.domain import Domain, used_predicates
from merlin_pddl.problem import Problem
from merlin_ros.robot_values import AVAILABLE


def robot_parameters(classes: Sequence[Needs], world: ApplicationWorld) -> Dict[str, str]:
    """Operator -> the variable that names its robot, for those that need one and are clear."""
    found = {}
    for needs in classes:
        try:
            variable = _parameter(needs, world)
        except ValueError:
            continue
        if variable:
            found[needs.operator] = variable
    return found


def check_robots(classes: Sequence[Needs], world: ApplicationWorld, robots: Sequence[str]) -> List[str]:
    """The mistakes, empty when everything fits.

    :param robots: their names; empty: the application has one robot without a name.
    """
    found: List[str] = []
    for needs in classes:
        try:
            variable = _parameter(needs, world) if robots or needs.robot_parameter else ""
        except ValueError as error:
            found.append(f"{needs.name}: {error}")
            continue
        if variable and robots:
            found += _fits(needs, variable, world, robots)
    if robots and not found and not robot_parameters(classes, world):
        found.append(
            f"no action has a parameter of type robot: nothing runs on {', '.join(robots)}; give one a "
            "parameter of this type, or name one with robot_parameter"
        )
    names = [robot for robot in sorted(set(robots)) if list(robots).count(robot) > 1]
    return [*(f"robot {name} is named twice" for name in names), *dict.fromkeys(found)]


def unnamed_robots(domain: Domain, problem: Problem) -> List[str]:
    """What is wrong with an application that names no robots: nothing makes `available` true then."""
    predicate = domain.predicates.get(AVAILABLE)
    said = any(fact.name == AVAILABLE for fact in problem.facts)
    if predicate is None or len(predicate.parameters) != 1 or said:
        return []
    effects = [effect for operator in domain.operators.values() for effect in operator.effects]
    if any(effect.atom is not None and effect.atom.name == AVAILABLE for effect in effects):
        return []
    (variable,) = predicate.parameters
    known = problem.typed(domain.constants)
    robots = ",".join(name for name, types in known.items() if domain.accepts(variable.types, types))
    for operator in domain.operators.values():
        if any((AVAILABLE, False) in used_predicates(each.condition) for each in operator.conditions):
            return [
                f"{operator.name} needs ({AVAILABLE} {variable.name}) of its robot, and no robot is named: "
                f"start it with robots:={robots}"
            ]
    return []


def _parameter(needs: Needs, world: ApplicationWorld) -> str:
    parameters = world.operators.get(needs.operator, ())
    return robot_parameter(needs.operator, parameters, world.parents, needs.robot_parameter)


def _fits(needs: Needs, variable: str, world: ApplicationWorld, robots: Sequence[str]) -> Iterator[str]:
    if needs.concurrent > 1:
        yield f"{needs.name} runs on a robot, one at a time; take out concurrent = {needs.concurrent}"
    kind = dict(world.operators[needs.operator])[variable]
    objects = sorted(world.objects(kind))
    for robot in robots:
        if robot not in objects:
            types = [name for name in world.parents if robot in world.objects(name)]
            own = [name for name in types if name not in [world.parents[other] for other in types]]
            what = f"is of type {' and '.join(own)}, not {kind}" if own else "is not an object of the problem"
            yield (
                f"robot {robot} {what}, as ?{variable} of {needs.operator} has to be; "
                f"objects of type {kind}: {', '.join(objects) or 'none'}"
            )

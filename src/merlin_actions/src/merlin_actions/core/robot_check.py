"""Whether an application fits its robots. Pure, as far as its caller is; one sentence for each mistake."""

from typing import Dict, Iterator, List, Sequence

from merlin_actions.core.application_check import ApplicationWorld, Needs
from merlin_actions.core.robot_parameter import robot_parameter


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

    :param robots: their names; none: the application has one robot, which has no name.
    """
    found: List[str] = []
    for needs in classes:
        if needs.concurrent < 1:
            found.append(f"{needs.name}.concurrent has to be 1 or more, not {needs.concurrent}")
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

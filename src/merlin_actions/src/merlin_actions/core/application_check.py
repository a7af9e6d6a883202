# SPDX-License-Identifier: Apache-2.0
"""Compares an application's parts with each other before the robot moves. Imports no ROS.

Each mistake is one sentence: where it is, what is wrong, what to do.
"""

from types import MappingProxyType
from typing import Callable, Collection, Dict, Iterator, List, Mapping, NamedTuple, Optional, Sequence, Tuple

from merlin_actions.core.names import DECLARED, HERE
from merlin_actions.core.robot_parameter import Parameters
from merlin_pddl.checks.literals import Literal
from merlin_pddl.text_reader import suggestion


class Needs(NamedTuple):
    """What a class of actions needs."""

    name: str
    operator: str
    parameters: Tuple[str, ...] = ()
    targets: Tuple[str, ...] = ()
    """Parameters that name points of interest."""
    points: Tuple[str, ...] = ()
    """Points of interest that its states name themselves."""
    servers: Tuple[Tuple[str, str], ...] = ()
    """Path of a state, and the action whose server it uses."""
    unset: Tuple[str, ...] = ()
    """A sentence for each userdata key that is read and never set."""
    robot_parameter: str = ""
    """The parameter that names the robot, as the class declares it."""
    concurrent: int = 1
    """How many of it run at once."""
    declared: Tuple[str, ...] = ()
    """What it declares with `while_running`, `if_interrupted` and `if_stopped_at`."""
    literals: Tuple[Literal, ...] = ()
    """Facts that its states and its source change."""
    adds_objects: bool = False
    """Whether its source adds objects, so that the problem need not have those of `literals`."""
    asked: Tuple[Tuple[str, str, Tuple[str, ...]], ...] = ()
    """Path of a state, the action whose server it uses, and the words or classes that it asks of it."""
    services: Tuple[Tuple[str, str], ...] = ()
    """Path of a state, and the service that it calls."""


class ApplicationWorld(NamedTuple):
    """What there is to compare with.

    :param operators: of the domain, in its order.
    :param objects: gives the objects of a type, subtypes included.
    :param points: names of the points of interest.
    :param servers: actions that have a server; None: not known.
    """

    operators: Mapping[str, Parameters]
    objects: Callable[[str], Collection[str]]
    points: Collection[str]
    servers: Optional[Collection[str]] = None
    parents: Mapping[str, str] = MappingProxyType({})
    """Types of the domain -> their parents."""
    facts: Mapping[str, Parameters] = MappingProxyType({})
    """Predicates and functions of the domain."""
    declared_fault: Callable[[str, str], str] = lambda text, operator: ""
    """What is wrong with a declared effect of an operator; empty: nothing, or the domain is not known."""
    literal_fault: Callable[[str, str, bool], str] = lambda text, operator, adds_objects: ""
    """What is wrong with facts or goals of a class; likewise. See `merlin_pddl.checks.literals`."""
    strangers: Collection[str] = ()
    """Nodes that may serve further actions, as they are not MERLIN's."""
    known: Mapping[str, Callable[[Sequence[str]], str]] = MappingProxyType({})
    """Action -> what its server says of words or classes that it does not know; empty: it knows them."""


class ApplicationError(ValueError):
    """The parts of an application do not fit; the text has one line for each mistake."""

    def __init__(self, mistakes: Sequence[str]) -> None:
        one = len(mistakes) == 1
        head = "" if one else f"{len(mistakes)} mistakes in the application:\n  "
        super().__init__(head + "\n  ".join(mistakes))
        self.mistakes = tuple(mistakes)


def check_application(classes: Sequence[Needs], world: ApplicationWorld, complete: bool = True) -> List[str]:
    """The mistakes of an application, one sentence each; empty when its parts fit.

    :param complete: every operator of the domain has to have a class.
    """
    found: List[str] = []
    served: Dict[str, str] = {}
    for needs in classes:
        found += _operator(needs, world)
        other = served.setdefault(needs.operator, needs.name)
        if other != needs.name:
            found.append(
                f"{needs.name} and {other} both run operator {needs.operator}; take one out of 'actions'"
            )
        found += [f"{needs.name}: {text}" for text in needs.unset]
        found += _declared(needs, world)
        found += _points(needs, world)
        found += [] if world.strangers else _servers(needs, world)
        found += _literals(needs, world)
        found += _asked(needs, world)
    if complete:
        known = {name.lower() for name in served}
        found += [
            f"operator {name} of the domain has no class; write one with parameters = "
            f"{[label for label, _ in parameters]} and name it in the launch file's 'actions'"
            for name, parameters in world.operators.items()
            if name.lower() not in known
        ]
    return list(dict.fromkeys(found))


def _operator(needs: Needs, world: ApplicationWorld) -> Iterator[str]:
    if needs.operator not in world.operators:
        names = ", ".join(world.operators) or "none"
        hint = suggestion(needs.operator, world.operators)
        yield (
            f"{needs.name}: the domain has no operator {needs.operator!r}{hint}, only {names}; "
            "rename the class, or set its attribute 'operator'"
        )
        return
    variables = [label for label, _ in world.operators[needs.operator]]
    if list(needs.parameters) != variables:
        yield (
            f"{needs.name} declares the parameters {list(needs.parameters)}, but operator "
            f"{needs.operator} of the domain has {variables}; make them equal"
        )


def _declared(needs: Needs, world: ApplicationWorld) -> Iterator[str]:
    if needs.operator in world.operators:
        for text in needs.declared:
            # A point of interest need not be an object of the problem; one of the points has to fit.
            points = sorted(world.points) if HERE in text else [""]
            faults = [
                world.declared_fault(text.replace(HERE, point), needs.operator) for point in points
            ] or [f"there is no point of interest for {HERE}"]
            if all(faults):
                yield (
                    f"{needs.name} declares {text!r}: {faults[0]}; "
                    f"correct its {', '.join(DECLARED[:-1])} or {DECLARED[-1]}"
                )


def _points(needs: Needs, world: ApplicationWorld) -> Iterator[str]:
    there = ", ".join(sorted(world.points)) or "none"
    add = f"add it to points_of_interest; there are: {there}"
    for point in needs.points:
        if point not in world.points:
            yield f"{needs.name} drives to {point!r}, which is not a point of interest; {add}"
    types = dict(world.operators.get(needs.operator, ()))
    for target in needs.targets:
        for name in sorted(world.objects(types[target])) if target in types else ():
            if name not in world.points:
                yield (
                    f"object {name} of the problem is not a point of interest, and {needs.name} drives to "
                    f"every {types[target]} (parameter ?{target}); {add}"
                )


def _servers(needs: Needs, world: ApplicationWorld) -> Iterator[str]:
    """What the launch file does not start, a sentence for each state that uses it."""
    for path, server in needs.servers:
        if world.servers is not None and server not in world.servers:
            there = ", ".join(sorted(world.servers)) or "none"
            use = f"state {path} of {needs.name} uses the action server {server!r}, which"
            if world.strangers:
                yield f"{use} {' or '.join(world.strangers)} has to serve; of MERLIN's nodes none does"
            else:
                yield f"{use} the launch file does not start; start it, or remap it. It starts: {there}"


def _literals(needs: Needs, world: ApplicationWorld) -> Iterator[str]:
    for where, text in needs.literals:
        fault = world.literal_fault(text, needs.operator, needs.adds_objects)
        if fault:
            yield f"{where} of {needs.name}: {text}: {fault}; correct it, or declare it in domain or problem"


def _asked(needs: Needs, world: ApplicationWorld) -> Iterator[str]:
    for path, server, words in needs.asked:
        fault = world.known[server](words) if server in world.known else ""
        if fault:
            yield f"state {path} of {needs.name} asks of {server}: {fault}; correct the state"


def not_looked_at(classes: Sequence[Needs], world: ApplicationWorld) -> List[str]:
    """What was not compared, since only a system that runs has it; a sentence each."""
    found: List[str] = []
    unknown: Dict[str, Dict[str, None]] = {}
    for needs in classes:
        found += _servers(needs, world) if world.strangers else []
        found += [
            f"service {name!r} of state {path} of {needs.name}: a node has to offer it"
            for path, name in needs.services
        ]
        for _, server, words in needs.asked:
            if server not in world.known:
                unknown.setdefault(server, {}).update(dict.fromkeys(words))
    found += [
        f"whether the server of {server!r} knows {', '.join(words)}: it is not one of MERLIN's"
        for server, words in unknown.items()
        if words
    ]
    return found

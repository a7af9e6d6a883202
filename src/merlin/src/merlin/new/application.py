# SPDX-License-Identifier: Apache-2.0
"""What is written of a new application: its actions, places, goals and PDDL. Without ROS."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Collection, Dict, List, Sequence, Tuple

from merlin.new.names import (
    MOST_PARAMETERS,
    NameRefused,
    check_operator,
    check_robot,
    check_symbol,
    class_name,
    module_name,
    needs_operator,
)
from merlin.new.robots_added import AT, VARIABLE, with_robots
from merlin_pddl.domain import Domain, Signature
from merlin_pddl.domain_reader import parse_domain
from merlin_pddl.formula import Atom, Comparison, Not, to_pddl
from merlin_pddl.formula_reader import parameters, typed_list
from merlin_pddl.problem_reader import parse_problem
from merlin_pddl.text_reader import Expression, PddlError, Word, read_expression, read_text, text_of

#: Points of interest of a new domain.
POINTS = ("hall", "kitchen")
#: Types of a new domain, and their parents.
TYPES = {"place": "object", "poi": "place"}
#: The type of several robots.
ROBOT = "robot"
#: Most robots of a new application: so many begin side by side in its room.
MOST_ROBOTS = 5
#: What is written when no action is named.
DEFAULT_ACTION = "greet ?p - poi"
#: m between two points of interest, and between them and the walls.
SPACING, MARGIN = 2.5, 1.5
#: m/s and s: how a drive's time is estimated, as `poi_distances --speed 0.3 --turning 3` does.
SPEED, TURNING = 0.3, 3.0

_SENTENCE = 70  # characters of what a new action says


class ApplicationRefused(ValueError):
    """The application cannot be written; the text says why and what to do."""


@dataclass(frozen=True)
class NewAction:
    """One operator and its class.

    :param at: the variable of the place where it happens; empty: anywhere.
    """

    operator: str
    parameters: Tuple[str, ...]
    types: Tuple[str, ...]
    at: str = ""

    @property
    def module(self) -> str:
        """Name of the Python module that is written for it."""
        return module_name(self.operator)

    @property
    def class_name(self) -> str:
        """Name of the Python class that is written for it."""
        return class_name(self.operator)

    @property
    def names_operator(self) -> bool:
        """Whether the class has to say which operator it runs."""
        return needs_operator(self.operator)

    @property
    def done(self) -> str:
        """The predicate that it makes true."""
        return f"{self.operator}_done"

    @property
    def typed(self) -> str:
        """Its parameters as PDDL."""
        return " ".join(f"?{name} - {kind}" for name, kind in zip(self.parameters, self.types))

    @property
    def sentence(self) -> str:
        """The sentence of the generated state, until the author replaces it."""
        text = self.operator.replace("_", " ").replace("-", " ").capitalize()
        for name in self.parameters:
            if len(text) + len(name) < _SENTENCE:
                text += f" {{{name}}}"
        return text + "."

    @property
    def effect(self) -> str:
        """Its effect, with its variables."""
        return f"({' '.join([self.done, *(f'?{name}' for name in self.parameters)])})"


@dataclass
class NewApplication:
    """A new application; the templates read its fields.

    :param robots: names of several robots in one plan; none: one robot without a name.
    :param domain_text: a domain that exists; empty: one is written. Likewise `problem_text`.
    """

    package: str
    actions: List[NewAction]
    points: List[str] = field(default_factory=lambda: list(POINTS))
    objects: Dict[str, str] = field(default_factory=dict)
    types: Dict[str, str] = field(default_factory=dict)
    goals: List[str] = field(default_factory=list)
    navigates: bool = True
    robots: Sequence[str] = ()
    domain_text: str = ""
    problem_text: str = ""

    @property
    def mission(self) -> str:
        """The class of the mission."""
        return f"{class_name(self.package)}Mission"

    @property
    def reserves(self) -> bool:
        """Whether a drive keeps the place to which it goes, which one that is stopped has to give free."""
        return bool(self.robots) and not self.domain_text

    @property
    def servers(self) -> Tuple[str, ...]:
        """The action servers that its actions use, as they are written."""
        return ("move_base",) * self.navigates + ("sound_play",) * bool(self.actions)

    @property
    def columns(self) -> int:
        """Points of interest in one row of the world."""
        return max(2, round(len(self.points) ** 0.5))

    @property
    def places(self) -> Dict[str, Tuple[float, float]]:
        """Point of interest → x, y, m."""
        return {
            name: (MARGIN + SPACING * (i % self.columns), MARGIN + SPACING * (i // self.columns))
            for i, name in enumerate(self.points)
        }

    @property
    def size(self) -> Tuple[float, float]:
        """Width and depth of the room, m."""
        rows = -(-len(self.points) // self.columns)
        return 2 * MARGIN + SPACING * (self.columns - 1), 2 * MARGIN + SPACING * max(1, rows)

    @property
    def starts(self) -> List[Tuple[float, float]]:
        """Where the robots begin: side by side between the last row and the wall, m."""
        count, (width, depth) = max(1, len(self.robots)), self.size
        return [(round(width * (i + 1) / (count + 1), 2), depth - MARGIN) for i in range(count)]

    def times(self) -> List[Tuple[str, str, float]]:
        """From, to and time of each drive, s."""
        places, (x, y) = self.places, (self.size[0] / 2, self.size[1] - MARGIN)
        starts = {"anywhere": (x, y), **places}
        return [
            (start, end, round(((a - c) ** 2 + (b - d) ** 2) ** 0.5 / SPEED + TURNING, 1))
            for start, (a, b) in starts.items()
            for end, (c, d) in places.items()
            if start != end
        ]


def new_application(
    package: str, specs: Sequence[str], kinds: Sequence[str] = (), robots: Sequence[str] = ()
) -> NewApplication:
    """An application with a domain of its own.

    :param specs: the actions, ``fetch ?o - object ?from ?to - place`` each.
    :param kinds: further types, ``box tray - object`` each.
    :param robots: names of several robots in one plan; each operator gets one.
    :raises NameRefused: for names that cannot be used.
    :raises ApplicationRefused: for text that is not an action or a list of types.
    """
    domain = Domain(package)
    for name, parent in TYPES.items():
        domain.types.declare(name, [parent])
    if robots:
        _check_robots(robots)
        domain.types.declare(ROBOT, ["object"])
    types = _new_types(domain, kinds)
    actions = [_read_action(spec, domain) for spec in specs or [DEFAULT_ACTION]]
    for action in actions:
        if robots and (VARIABLE[1:] in action.parameters or ROBOT in action.types):
            raise ApplicationRefused(
                f"--action '{action.operator}': --robots adds the robot, as {VARIABLE}; leave it out, "
                "and call no other parameter so"
            )
    _check_modules(actions)
    application = NewApplication(package, actions, types=types, robots=robots)
    _add_objects(application, domain)
    application.goals = [_goal(action, application, domain) for action in actions]
    _check_taken(robots, {"anywhere", *application.points, *application.objects})
    return application


def application_of(
    package: str, domain_file: Path, problem_file: Path, robots: Sequence[str] = ()
) -> NewApplication:
    """An application around a domain and a problem that exist; its goals are those of the problem.

    :param robots: names of several robots in one plan. A domain without the type ``robot`` gets it, and a
        robot in each operator and in ``robot_at``.
    :raises PddlError: when one of the files is not PDDL.
    :raises NameRefused: when an operator cannot be a class.
    :raises ApplicationRefused: when the problem has no goals that a mission can send.
    """
    domain_text, problem_text = text_of(domain_file), text_of(problem_file)
    domain = parse_domain(domain_text, str(domain_file))
    if robots:
        _check_robots(robots)
        if ROBOT not in domain.types:
            before = parse_problem(problem_text, domain, str(problem_file))
            _check_taken(robots, before.typed(domain.constants))
            names = str(domain_file), str(problem_file)
            domain_text, problem_text = with_robots(domain_text, problem_text, robots, names)
            domain = parse_domain(domain_text, str(domain_file))
    problem = parse_problem(problem_text, domain, str(problem_file))
    for robot in robots:
        if not domain.accepts((ROBOT,), problem.typed(domain.constants).get(robot, ())):
            raise ApplicationRefused(f"{problem_file} has no object {robot} of type {ROBOT}; add it")
    navigate = domain.operators.get("navigate")
    navigates = navigate is not None and _is_ready_navigate(navigate, domain, robots)
    actions = []
    for operator in domain.operators.values():
        if operator is navigate and navigates:
            continue
        check_operator(operator.name, {})
        variables = tuple(_labels(operator, domain, robots))
        actions.append(NewAction(operator.name, variables, ()))
    _check_modules(actions)
    application = NewApplication(package, actions, navigates=navigates, robots=robots)
    application.domain_text, application.problem_text = domain_text, problem_text
    application.goals = [_sendable(goal, problem_file) for goal in problem.goals]
    if not application.goals:
        raise ApplicationRefused(f"{problem_file} has no goal; write the one that the mission shall send")
    if navigates and navigate is not None:
        wanted = next(each.types for each in navigate.parameters if each.label == "to")
        objects = problem.typed(domain.constants).items()
        fitting = [name for name, types in objects if domain.accepts(wanted, types) and name != "anywhere"]
        application.points = fitting or list(POINTS)
    return application


def _labels(operator: Signature, domain: Domain, robots: Sequence[str]) -> List[str]:
    """Its parameters; of several robots without the robot, which the base class of actions adds."""
    kinds = {each.label: each.types for each in operator.parameters}
    its = [
        label for label, types in kinds.items() if robots and all(domain.types.is_a(t, ROBOT) for t in types)
    ]
    return [label for label in kinds if len(its) != 1 or label not in its]


def _check_robots(robots: Sequence[str]) -> None:
    """Refuses names of robots that cannot be used, and more of them than the new room has space for."""
    for name in robots:
        check_robot(name)
        if robots.count(name) > 1:
            raise NameRefused(f"robot '{name}' is named twice")
    if len(robots) > MOST_ROBOTS:
        raise ApplicationRefused(
            f"--robots: {len(robots)} robots; at most {MOST_ROBOTS} begin in the new room"
        )


def _check_taken(robots: Sequence[str], objects: Collection[str]) -> None:
    """Refuses names of robots that other objects have."""
    for name in robots:
        if name in objects:
            raise ApplicationRefused(f"--robots: {name} is an object already; call the robot something else")


def _is_ready_navigate(operator: Signature, domain: Domain, robots: Sequence[str]) -> bool:
    """Whether MERLIN's own Navigate runs this operator."""
    labels = _labels(operator, domain, robots)
    return labels == ["from", "to"] and AT in domain.predicates and "anywhere" in domain.constants


def _sendable(goal: object, file: Path) -> str:
    inner = goal.part if isinstance(goal, Not) else goal
    text = to_pddl(goal)  # type: ignore[arg-type]
    if not isinstance(inner, (Atom, Comparison)):
        raise ApplicationRefused(f"{file}: a mission sends facts and comparisons; the goal {text} is neither")
    return text


def _new_types(domain: Domain, kinds: Sequence[str]) -> Dict[str, str]:
    found: Dict[str, str] = {}
    for text in kinds:
        try:
            listed = typed_list(read_text(text.lower(), "--type"), domain, variables=False)
        except PddlError as error:
            raise ApplicationRefused(
                f"--type '{text}': {error.message}; write e.g. 'box tray - object'"
            ) from error
        for word, parents in listed:
            check_symbol("type", word)
            if word in domain.types:
                raise ApplicationRefused(f"--type '{text}': there is a type '{word}' already")
            if "place" in parents or len(parents) > 1:
                raise ApplicationRefused(
                    f"--type '{text}': a place that the robot can drive to is a poi; write '- poi'"
                )
            domain.types.declare(str(word), parents)
            found[str(word)] = parents[0]
    return found


def _read_action(spec: str, domain: Domain) -> NewAction:
    """Reads ``fetch ?o - object ?from ?to - place``, in parentheses or not.

    :raises NameRefused: for names that cannot be used.
    :raises ApplicationRefused: when it is something else.
    """
    text = spec.strip()
    try:
        node = read_expression(text if text.startswith("(") else f"({text})", "--action")
        if not node or not isinstance(node[0], Word):
            raise node.error("an action begins with its name")
        operator = node[0].written
        listed = Expression("--action", node.line, node.column)
        listed.extend(node[1:])
        variables = parameters(listed, domain, operator)
    except PddlError as error:
        hint = "" if "unknown type" not in error.message else "; --type 'box - object' declares one"
        raise ApplicationRefused(f"--action '{spec}': {error.message}{hint}") from error
    check_operator(operator)
    if len(variables) > MOST_PARAMETERS:
        raise NameRefused(
            f"action '{operator}' has {len(variables)} parameters; the most is {MOST_PARAMETERS}"
        )
    for variable in variables:
        check_symbol("parameter", variable.label)
        if len(variable.types) > 1:
            raise ApplicationRefused(f"--action '{spec}': give {variable.name} one type, not (either …)")
    places = [v.name for v in variables if domain.types.is_a(v.types[0], "place")]
    return NewAction(
        operator,
        tuple(v.label for v in variables),
        tuple(v.types[0] for v in variables),
        places[0] if places else "",
    )


def _check_modules(actions: Sequence[NewAction]) -> None:
    seen: Dict[str, str] = {}
    for action in actions:
        other = seen.setdefault(action.module, action.operator)
        if other != action.operator or [a.operator for a in actions].count(other) > 1:
            raise NameRefused(f"the actions '{other}' and '{action.operator}' would be one class; rename one")
        if action.done in (a.operator for a in actions):
            raise NameRefused(f"action '{action.done}': the predicate of '{action.operator}' has this name")


def _add_objects(application: NewApplication, domain: Domain) -> None:
    """Adds as many objects of each type as one action needs at once, besides the points of interest."""
    for action in application.actions:
        for kind in action.types:
            if kind in TYPES:
                continue
            names = [f"{kind}_{i + 1}" for i in range(action.types.count(kind))]
            application.objects.update((name, kind) for name in names)
            if domain.types.is_a(kind, "poi"):
                application.points.extend(name for name in names if name not in application.points)


def _goal(action: NewAction, application: NewApplication, domain: Domain) -> str:
    """The action done with the objects of the problem; the places differ where they can."""
    used: List[str] = []
    for kind in action.types:
        fitting = [name for name, own in application.objects.items() if domain.types.is_a(own, kind)]
        if kind in TYPES:
            fitting = application.points
        left = [name for name in fitting if name not in used]
        used.append((left or fitting)[0])
    return f"({' '.join([action.done, *used])})"

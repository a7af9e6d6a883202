# SPDX-License-Identifier: Apache-2.0
"""A planning task without some of its ground actions, as PDDL that every planner with negation reads.

Each operator concerned gets a predicate that says what is left out, and the condition that it does not hold.
"""

from typing import Dict, Iterable, List, Sequence, Set, Tuple

from merlin_pddl.analysis.domain_text import require, section, unused, words
from merlin_pddl.domain import Domain, Operator
from merlin_pddl.domain_reader import DomainReader
from merlin_pddl.formula import types_text
from merlin_pddl.plan_text import call_text
from merlin_pddl.problem_reader import parse_problem
from merlin_pddl.text_reader import Expression, Word, line_starts, name_of, read_expression, suggestion

ANY = "*"
#: Begins the predicates that say which actions are left out.
LEFT_OUT = "left-out-"
_NEGATION = ":negative-preconditions"
Ground = Tuple[str, ...]


def leave_out(domain: str, problem: str, actions: Sequence[str]) -> Tuple[str, str]:
    """Domain and problem as text, without some actions.

    :param domain, problem: PDDL text.
    :param actions: as PDDL text; ``*`` stands for any argument: ``(navigate * kitchen)``.
    :raises PddlError: the text is not PDDL, or an action is not one of domain and problem.
    """
    node = read_expression(domain, "domain")
    model = DomainReader(read_expression(domain, "domain")).read()
    objects = parse_problem(problem, model, constraints=True).typed(model.constants)
    left_out: Dict[str, Set[Ground]] = {}
    for text in actions:
        operator, patterns = action_of(text, model, objects, (ANY,))
        left_out.setdefault(operator.name, set()).update(_expanded(operator, patterns, model, objects))
    marks = {name: _forbid(node, model.operators[name]) for name in left_out}
    require(node, [_NEGATION])
    facts = "".join(
        f"\n{call_text(marks[name], terms)}"
        for name, grounds in left_out.items()
        for terms in sorted(grounds)
    )
    return node.text(), _after_init(problem, facts)


def action_of(
    text: str, domain: Domain, objects: Iterable[str], wild: Sequence[str] = ()
) -> Tuple[Operator, List[Word]]:
    """The operator of an action as PDDL text, and its arguments.

    :param objects: that there are.
    :param wild: words that may stand for any of them.
    :raises PddlError: it is not an action of the domain with such objects.
    """
    node = read_expression(text, "action")
    operator = domain.operators.get(node.head)
    if operator is None:
        raise node.error(f"the domain has no action '{node.head}'{suggestion(node.head, domain.operators)}")
    words = [
        word if isinstance(word, Word) and word in wild else name_of(word, "an object") for word in node[1:]
    ]
    if len(words) != len(operator.parameters):
        raise node.error(f"'{node.head}' takes {len(operator.parameters)} objects, not {len(words)}")
    known = {*wild, *(name.lower() for name in objects)}
    for word in words:
        if word not in known:
            raise word.error(f"there is no object '{word}'{suggestion(word, known)}")
    return operator, words


def _expanded(
    operator: Operator, words: Sequence[str], domain: Domain, objects: Dict[str, Tuple[str, ...]]
) -> List[Ground]:
    """The argument lists that a pattern means."""
    found: List[Ground] = [()]
    for word, parameter in zip(words, operator.parameters):
        fitting = [name for name, types in objects.items() if domain.accepts(parameter.types, types)]
        choices = fitting if word == ANY else [word]
        found = [(*begin, choice.lower()) for begin in found for choice in choices]
    return found


def declare(node: Expression, prefix: str, operator: Operator) -> Tuple[str, str]:
    """Adds a predicate over the parameters of an operator to a domain.

    :param prefix: of its name, which no other word of the domain has.
    :return: its name, and its atom over these parameters.
    """
    name = unused(f"{prefix}{operator.name}", words([node]))
    typed = "".join(f" {parameter.name} - {types_text(parameter.types)}" for parameter in operator.parameters)
    section(node, ":predicates").append(read_expression(f"({name}{typed})"))
    return name, f"({' '.join((name, *(parameter.name for parameter in operator.parameters)))})"


def extend_action(node: Expression, operator: Operator, key: str, part: str) -> None:
    """Adds a part to the condition or effect of an operator.

    :param key: ``:condition``, ``:precondition`` or ``:effect``.
    """
    for action in node:
        if action.head not in (":action", ":durative-action") or action[1] != operator.name:
            continue
        assert isinstance(action, Expression)
        if key not in action:
            action[2:2] = [Word.at(key, "", 0, 0), read_expression("(and)")]
        place = action.index(Word(key)) + 1
        old = action[place]
        assert isinstance(old, Expression)
        both = read_expression(f"(and {part})")
        if old.head == "and":
            both.extend(old[1:])
        elif old:
            both.append(old)
        action[place] = both


def _forbid(node: Expression, operator: Operator) -> str:
    """Gives an operator the condition that it is not left out; returns the name of the predicate."""
    name, atom = declare(node, LEFT_OUT, operator)
    key = ":condition" if operator.durative else ":precondition"
    extend_action(node, operator, key, f"(at start (not {atom}))" if operator.durative else f"(not {atom})")
    return name


def _after_init(problem: str, facts: str) -> str:
    """A problem with further facts; its text stays as it was otherwise, for the spelling of its objects."""
    problem = problem.lstrip("\ufeff")  # does not count in places
    sections = {part.head: part for part in read_expression(problem, "problem")[1:]}
    init = sections.get(":init")
    beside = init[0] if isinstance(init, Expression) else sections.get(":goal", list(sections.values())[-1])
    place = line_starts(problem)[beside.line - 1] + beside.column - 1
    if init is None:
        return f"{problem[:place]}(:init {facts})\n{problem[place:]}"
    place += len(":init")
    return f"{problem[:place]}{facts}\n{problem[place:]}"

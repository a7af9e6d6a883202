"""The problem of other goals than those of the knowledge base, from its present state."""

from typing import Sequence

from merlin_pddl.domain import Domain
from merlin_pddl.knowledge import conjuncts
from merlin_pddl.problem import Problem
from merlin_pddl.problem_reader import parse_condition
from merlin_pddl.problem_writer import write_problem


def write_goal_problem(domain: Domain, problem: Problem, goals: Sequence[str]) -> str:
    """The problem as PDDL text, with these goals in place of its own ones.

    :param problem: a copy of the state; its goals are replaced.
    :param goals: PDDL text.
    :raises PddlError: a goal is not PDDL, or not one of the domain.
    """
    objects = {**domain.constants, **{name.lower(): kinds for name, kinds in problem.objects.items()}}
    problem.goals = [part for text in goals for part in conjuncts(parse_condition(text, domain, objects))]
    problem.instance_goals = []
    return write_problem(problem, domain)

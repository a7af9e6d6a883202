# SPDX-License-Identifier: Apache-2.0
"""Goals that come as items name their arguments by the declared keys, or by none of them."""

import pytest
from diagnostic_msgs.msg import KeyValue
from rosplan_knowledge_msgs.msg import DomainFormula, KnowledgeItem

from merlin_executor.goal_check import GoalError, check_goals
from merlin_planning.knowledge_text import parse_goal, to_pddl


class World:
    """What a knowledge client says about a small domain."""

    def predicates(self):
        return {"door": DomainFormula("door", [KeyValue("from", "room"), KeyValue("to", "room")])}

    def function_signatures(self):
        return {"way": DomainFormula("way", [KeyValue("from", "room"), KeyValue("to", "room")])}

    def instances(self, type_name=""):
        return {"": ["a", "B", "cup"], "room": ["a", "B"], "cup": ["cup"]}[type_name]

    def objects(self):
        return {"a": "room", "B": "hall", "cup": "vessel"}


def checked(item):
    check_goals([item], World())
    return to_pddl(item)


def pairs(values):
    return [KeyValue(*pair) for pair in values]


@pytest.mark.parametrize(
    "values, order",
    [
        ([("to", "b"), ("from", "a")], "a b"),
        ([("p0", "b"), ("p1", "a")], "b a"),
        ([("", "b"), ("", "a")], "b a"),
    ],
)
def test_arguments_are_in_the_declared_order(values, order):
    fact = KnowledgeItem(knowledge_type=KnowledgeItem.FACT, attribute_name="Door", values=pairs(values))
    assert checked(fact) == f"(Door {order})"
    (comparison,) = parse_goal("(> (way a a) 3)")
    comparison.ineq.LHS.tokens[0].function.typed_parameters = pairs(values)
    assert checked(comparison) == f"(> (way {order}) 3)"


def test_keys_of_which_only_some_are_declared_are_refused():
    values = pairs([("to", "b"), ("x", "a")])
    fact = KnowledgeItem(knowledge_type=KnowledgeItem.FACT, attribute_name="door", values=values)
    with pytest.raises(GoalError, match="the keys of 'door' are 'to', 'x', declared are 'from', 'to'"):
        checked(fact)


@pytest.mark.parametrize(("name", "goal"), [("door", "(door a Cup)"), ("way", "(> (way a Cup) 3)")])
def test_an_object_of_another_type_is_refused(name, goal):
    with pytest.raises(GoalError) as refused:
        checked(parse_goal(goal)[0])
    assert str(refused.value) == f"{goal}: 'Cup' is of type vessel, but '{name}' takes room for 'to'"


def test_an_object_of_a_type_below_is_taken():
    assert checked(parse_goal("(door A b)")[0]) == "(door A b)"


@pytest.mark.parametrize(
    ("goal", "why"),
    [
        ("(window)", "the domain has no predicate 'window', only door"),
        ("(door a)", "'door' takes 2 arguments, not 1"),
        ("(door a moon)", "there is no object 'moon'"),
        ("(> (height) 3)", "the domain has no function 'height', only way"),
    ],
)
def test_what_makes_no_sense_says_why(goal, why):
    with pytest.raises(GoalError) as refused:
        checked(parse_goal(goal)[0])
    assert str(refused.value) == f"{goal}: {why}"


def test_names_do_not_depend_on_case():
    assert checked(parse_goal("(DOOR A B)")[0]) == "(DOOR A B)"

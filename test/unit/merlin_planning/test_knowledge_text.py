# SPDX-License-Identifier: Apache-2.0
"""Goals and facts as PDDL text."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosplan_knowledge_msgs.msg import ExprBase, ExprComposite, KnowledgeItem

from merlin_pddl.text_reader import MAX_DEPTH
from merlin_planning.knowledge_text import PDDLSyntaxError, parse_goal, parse_literals, to_pddl

NAMES = st.from_regex(r"[a-z][a-z0-9_-]{0,8}", fullmatch=True).filter(
    lambda name: name not in ("and", "not", "or", "imply", "forall", "exists", "when")
)
LITERALS = st.builds(
    lambda name, arguments, negative: (
        f"(not ({' '.join([name, *arguments])}))" if negative else f"({' '.join([name, *arguments])})"
    ),
    NAMES,
    st.lists(NAMES, max_size=3),
    st.booleans(),
)


@given(LITERALS)
def test_a_literal_survives_the_way_there_and_back(text: str) -> None:
    assert [to_pddl(item) for item in parse_goal(text)] == [text]


@given(st.lists(LITERALS, min_size=1, max_size=4))
def test_a_conjunction_is_its_parts_in_order(texts: list) -> None:
    items = parse_goal("(and " + "\n ".join(texts) + ")")
    assert [to_pddl(item) for item in items] == texts


@pytest.mark.parametrize(
    "text",
    [
        "(>= (battery) 20)",
        "(< (+ (load r1) 2) (* 3 (capacity r1)))",
        "(= (distance a b) 4.5)",
        "(> (- (x)) -1)",
    ],
)
def test_comparisons_survive(text: str) -> None:
    (item,) = parse_goal(text)
    assert item.knowledge_type == KnowledgeItem.INEQUALITY
    assert to_pddl(item) == text


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_number_survives_with_all_its_digits(number: float) -> None:
    item = KnowledgeItem(
        knowledge_type=KnowledgeItem.FUNCTION, attribute_name="odometer", function_value=number
    )
    (goal,) = parse_goal(to_pddl(item))
    assert goal.ineq.RHS.tokens[0].constant == number
    assert to_pddl(goal) == to_pddl(item)


@pytest.mark.parametrize(
    "text, part",
    [
        ("(checked kitchen", "never closed"),
        ("checked kitchen)", "closes nothing"),
        ("", "no PDDL here"),
        ("checked", "expected '('"),
        ("(a) (b)", "nothing may follow"),
        ("()", "empty"),
        ("(checked (kitchen))", "argument"),
        ("(or (a) (b))", "'or'"),
        ("(not (a) (b))", "one fact"),
        ("(not (not (a)))", "plain fact"),
        ("(not (and (a) (b)))", "plain fact"),
        ("(not (and))", "plain fact"),
        ("(not (> (n) 3))", "plain fact"),
        ("(> (battery))", "two expressions"),
        ("(> (battery) full)", "neither a number nor a function"),
        ("(9lives)", "not a name"),
    ],
)
def test_what_is_no_goal_is_refused_with_the_reason(text: str, part: str) -> None:
    with pytest.raises(PDDLSyntaxError, match="(?i)" + part.replace("(", r"\(").replace(")", r"\)")):
        parse_goal(text)


def test_names_keep_their_letters() -> None:
    assert to_pddl(parse_goal("(AND (Checked Kitchen))")[0]) == "(Checked Kitchen)"


@given(st.text(max_size=40))
def test_any_text_gives_goals_or_a_reason(text: str) -> None:
    try:
        parse_goal(text)
    except PDDLSyntaxError as error:
        assert str(error)


def test_variables_are_bound_in_any_case() -> None:
    items = parse_literals(["(robot_at ?To)", "(not (robot_at ?from))"], {"to": "kitchen", "From": "hall"})
    assert [to_pddl(item) for item in items] == ["(robot_at kitchen)", "(not (robot_at hall))"]


def test_a_goal_of_any_kind_has_its_text() -> None:
    (compared,) = parse_goal("(= (n) 3)")
    compared.is_negative = True
    text = "(forall (?p - poi) (checked ?p))"
    expression = KnowledgeItem(knowledge_type=KnowledgeItem.EXPRESSION, attribute_name=text)
    assert [to_pddl(compared), to_pddl(expression)] == ["(not (= (n) 3))", text]
    expression.is_negative = True
    assert to_pddl(expression) == f"(not {text})"


def test_long_sums_may_be_written_as_in_pddl() -> None:
    (goal,) = parse_goal("(> (battery) (+ (a) 1 (* 2 (b) (c))))")
    assert to_pddl(goal) == "(> (battery) (+ (+ (a) 1) (* (* 2 (b)) (c))))"


def test_an_unbound_variable_is_named() -> None:
    with pytest.raises(PDDLSyntaxError, match=r"\?to"):
        parse_literals(["(robot_at ?to)"], {})


def nested(depth: int) -> str:
    return "(and " * (depth - 1) + "(checked kitchen)" + ")" * (depth - 1)


def test_text_may_be_nested_but_not_without_end() -> None:
    assert to_pddl(parse_goal(nested(MAX_DEPTH))[0]) == "(checked kitchen)"
    for depth in (MAX_DEPTH + 1, 1000, 100_000):
        with pytest.raises(PDDLSyntaxError, match=f"nested deeper than {MAX_DEPTH}") as caught:
            parse_goal(nested(depth))
        assert len(str(caught.value)) < 300


def test_an_expression_of_any_depth_has_a_text() -> None:
    """A knowledge item comes from a client as it is: no parser has checked it."""
    operators = [ExprBase(expr_type=ExprBase.OPERATOR, op=ExprBase.ADD)] * 5000
    item = KnowledgeItem(knowledge_type=KnowledgeItem.EXPRESSION, expr=ExprComposite(tokens=operators))
    assert to_pddl(item).count("(+") == 5000
    unknown = ExprBase(expr_type=ExprBase.OPERATOR, op=99)
    item.expr.tokens = [unknown, ExprBase(expr_type=ExprBase.CONSTANT, constant=1.0)]
    assert to_pddl(item) == " (? 1 ?)"

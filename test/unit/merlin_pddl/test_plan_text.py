# SPDX-License-Identifier: Apache-2.0
"""Plans as text."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from merlin_pddl.plan_text import PlanStep, PlanTextError, format_plan, parse_plan, restore_case


def test_lines_become_steps_in_the_order_of_time():
    steps = parse_plan(
        "; a comment with (all) [of] them: 1\n"
        "10.5: (ask kitchen)  [5.000]\n"
        "0.000: (navigate  main_door   kitchen )  [1e1]\n"
        "States evaluated: 3\n"
    )
    assert [(s.time, s.name, s.arguments, s.duration, s.line) for s in steps] == [
        (0.0, "navigate", ("main_door", "kitchen"), 10.0, 3),
        (10.5, "ask", ("kitchen",), 5.0, 2),
    ]


def test_an_empty_line_ends_the_plan_but_does_not_begin_it():
    assert [s.name for s in parse_plan("\n\n0: (a) [1]\n\n1: (b) [1]\n")] == ["a"]


def test_no_text_is_an_empty_plan():
    assert parse_plan("") == []


def test_a_damaged_line_is_named():
    with pytest.raises(PlanTextError, match="line 2"):
        parse_plan("0: (a) [1]\nsoon: (b) [1]\n")


def test_what_is_written_reads_the_same():
    steps = [PlanStep(0.0, "a", ("x", "y"), 1.5, 1), PlanStep(2.25, "b", (), 0.001, 2)]
    assert parse_plan(format_plan(steps)) == steps


@settings(max_examples=300, deadline=None)
@given(st.text(max_size=200))
def test_any_text_is_read_or_refused(text):
    try:
        for step in parse_plan(text):
            assert step.name
    except PlanTextError as error:
        assert "line" in str(error)


def test_objects_get_the_spelling_of_the_problem():
    problem = "(:objects Kitchen main_door Hall hall - place) ; KITCHEN in a comment\n"
    steps = [PlanStep(0.0, "NAVIGATE", ("KITCHEN", "MAIN_DOOR", "HALL"))]
    restored = restore_case(steps, problem)[0]
    assert restored.name == "navigate"
    assert restored.arguments == ("Kitchen", "main_door", "HALL")


@pytest.mark.parametrize(
    "line, reason",
    [
        ("1e300: (a) [1]", "time 1e300 is not between 0 and"),
        ("-1: (a) [1]", "time -1 is not between 0 and"),
        ("0: (a) [-1]", "duration -1 is not between 0 and"),
        ("nan: (a) [1]", "time 'nan' is not a number"),
        ("0: (a) [inf]", "duration 'inf' is not a number"),
        ("0: (a [1]", "is not '<time>"),
        ("0: (a)", "is not '<time>"),
        ("(a)", "is not '<time>"),
        ("0: () [1]", "is not '<time>"),
        ("x", "is not an action, and there is none in the whole text"),
        ("garbage", "is not an action, and there is none in the whole text"),
    ],
)
def test_what_makes_no_plan_is_refused_with_its_line(line, reason):
    with pytest.raises(PlanTextError) as error:
        parse_plan(f"; a comment\n{line}\n")
    assert "line 2" in str(error.value) and reason in str(error.value)


def test_comments_alone_are_an_empty_plan():
    assert parse_plan("; cost = 0\n\n; done\n") == []


@pytest.mark.parametrize("blank", ["\xa0", "\x85", "\u2028", "\x1c"])
def test_other_blanks_part_neither_words_nor_lines(blank):
    (step,) = parse_plan(f"0: (go{blank}home now) [1]\n")
    assert (step.name, step.arguments) == (f"go{blank}home", ("now",))

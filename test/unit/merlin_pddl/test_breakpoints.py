# SPDX-License-Identifier: Apache-2.0
"""Breakpoints: what is held before it begins, step and continue."""

import pytest
from merlin_msgs.srv import BreakpointsRequest

from merlin_pddl.breakpoints import MOST, BreakpointError, Breakpoints
from merlin_planning.breakpoint_service import BreakpointService

DRIVE, ASK = "(navigate hall kitchen)", "(ask kitchen)"


@pytest.fixture
def points():
    return Breakpoints()


def test_without_breakpoints_nothing_is_asked(points):
    assert not points.armed
    points.set(["(navigate * kitchen)"])
    assert points.armed
    points.set([])
    assert not points.armed


@pytest.mark.parametrize(
    ("pattern", "held"),
    [
        ("(navigate * kitchen)", True),
        ("(NAVIGATE hall *)", True),
        ("navigate", True),
        ("(navigate)", True),
        ("(navigate * hall)", False),
        ("(navigate kitchen)", False),
        ("(ask kitchen)", False),
    ],
)
def test_a_breakpoint_holds_what_it_fits(points, pattern, held):
    points.set([pattern])
    assert points.admit([DRIVE]) == ([] if held else [0])
    assert points.held == (DRIVE if held else "")


def test_goals_are_held_by_any_of_them(points):
    points.set(["(checked kitchen)"])
    assert points.admit(["(not (checked kitchen)) (>= (battery) 20)"]) == []


def test_what_continues_is_held_when_it_comes_again(points):
    points.set(["(ask *)"])
    assert points.admit([DRIVE, ASK]) == [0]
    assert points.held == ASK
    assert points.admit([ASK]) == points.admit([DRIVE, ASK]) == []  # nothing overtakes it
    points.go_on()
    assert points.held == ""
    assert points.admit([ASK]) == [0]  # its conditions may not hold yet: it is asked for again
    assert points.admit([ASK]) == [0]
    points.began(ASK)
    assert points.admit([ASK]) == [] and points.held == ASK


def test_a_step_lets_one_begin(points):
    points.step()
    assert points.admit([DRIVE, ASK]) == [] and points.held == DRIVE
    points.step()
    assert points.admit([ASK, DRIVE]) == [1]
    points.began(DRIVE)
    assert points.admit([ASK]) == [] and points.held == ASK
    points.go_on()
    assert points.admit([ASK]) == [0]
    points.began(ASK)
    assert not points.armed


def test_what_is_held_and_not_wanted_any_more_is_forgotten(points):
    points.set(["(ask *)"])
    points.admit([ASK])
    assert points.admit([DRIVE]) == [0] and points.held == ""
    points.step()
    points.admit([DRIVE])
    points.ended(stepping=True)
    assert points.held == "" and points.admit([DRIVE]) == []
    points.ended(stepping=False)
    assert points.admit([DRIVE]) == [0]


@pytest.mark.parametrize("text", ["", "()", "(a", "(a (b))", "(* kitchen)", "a?", "(" + "a" * 500 + ")"])
def test_what_is_no_breakpoint_is_refused(points, text):
    points.set(["(ask *)"])
    with pytest.raises(BreakpointError):
        points.set([text])
    assert points.texts == ["(ask *)"]


def test_the_service_says_what_is_so(points):
    changes = []
    service = BreakpointService(points, lambda: changes.append(points.texts))

    def ask(what, *before):
        return service.answer(BreakpointsRequest(what, list(before)))

    assert ask(BreakpointsRequest.SET, "(ask *)").success and changes == [["(ask *)"]]
    points.admit([ASK])
    assert ask(BreakpointsRequest.CONTINUE).message == "(ask kitchen) begins."
    assert not ask(BreakpointsRequest.SET, *["a"] * (MOST + 1)).success
    assert not ask(9).success and len(changes) == 2
    assert ask(BreakpointsRequest.CLEAR).success and points.texts == []

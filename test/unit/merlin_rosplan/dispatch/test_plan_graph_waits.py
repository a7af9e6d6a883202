# SPDX-License-Identifier: Apache-2.0
"""What the start of an action waits for: earlier ends, unless a deadline leaves no time, and timed values."""

from typing import Dict, List, Tuple, Union

import pytest

from merlin_pddl.formula import Comparison, Fluent, Number
from merlin_pddl.plan_text import PlanStep
from merlin_rosplan.dispatch.operator_model import (
    ActionModel,
    Conditions,
    Inequality,
    PlanTerm,
    TimedEffects,
)
from merlin_rosplan.dispatch.plan_graph import Edge, TimedLiteral, TimedValue
from merlin_rosplan.dispatch.plan_graph_builder import build_graph

BREAD, SOUP, MENU, CHARGE = map(PlanTerm, ("bread", "soup", "menu", "charge"))
BAKE = ActionModel("bake", (), end_effects=TimedEffects(add=(BREAD,)))
COOK = ActionModel(
    "cook",
    (),
    at_end=Conditions(positive=(BREAD,)),
    end_effects=TimedEffects(add=(SOUP,), writes=(CHARGE,)),
)
SERVE = ActionModel("serve", (), at_end=Conditions(positive=(SOUP,)), end_effects=TimedEffects(add=(MENU,)))
CHARGED = Conditions(comparisons=(Inequality(Comparison(">=", Fluent("charge"), Number(3.0))),))
Timed = Union[TimedLiteral, TimedValue]


def edges(actions: List[ActionModel], times: List[Tuple[float, float]], *timed: Timed) -> Dict:
    """The edges of a plan by their nodes: 1 and 2 are start and end of the first action, and so on.

    :param times: start and duration of each action.
    """
    steps = [PlanStep(start, action.name, (), lasts) for action, (start, lasts) in zip(actions, times)]
    found: List[Edge] = build_graph(steps, actions, timed).edges
    return {(edge.source, edge.sink): edge for edge in found}


@pytest.mark.parametrize("timed", [TimedLiteral(9.0, SOUP, negative=True), TimedValue(9.0, CHARGE, 0.0)])
def test_an_action_whose_end_has_a_deadline_does_not_wait_beyond_it(timed: Timed) -> None:
    plan = [BAKE, COOK], [(0.0, 5.0), (1.0, 6.0)]
    assert (2, 3) in edges(*plan), "cook begins when the bread is there"
    found = edges(*plan, timed)  # that would end after 11 s
    assert (2, 3) not in found and found[1, 3].lower == 1.0, "it begins as planned"


def test_what_waits_itself_counts_for_those_that_wait_for_it() -> None:
    plan = [BAKE, COOK, SERVE], [(0.0, 5.0), (1.0, 6.0), (2.0, 6.0)]
    assert {(2, 3), (4, 5)} <= set(edges(*plan))
    found = edges(*plan, TimedLiteral(15.0, MENU, negative=True))  # cook ends after 11 s, serve after 17 s
    assert (2, 3) in found and (4, 5) not in found and found[3, 5].lower == 1.0


@pytest.mark.parametrize(("when", "node"), [("at_start", 1), ("over_all", 1), ("at_end", 2)])
def test_a_condition_on_a_number_waits_for_the_timed_value(when: str, node: int) -> None:
    work = ActionModel("work", (), **{when: CHARGED})
    assert edges([work], [(10.0, 5.0)], TimedValue(8.0, CHARGE, 5.0))[0, node].lower == 8.0


def test_a_timed_value_that_an_action_has_changed_since_is_not_waited_for() -> None:
    work = ActionModel("work", (), at_start=CHARGED)
    found = edges([COOK, work], [(0.0, 9.0), (10.0, 5.0)], TimedValue(8.0, CHARGE, 5.0))
    assert (2, 3) in found and (0, 3) not in found

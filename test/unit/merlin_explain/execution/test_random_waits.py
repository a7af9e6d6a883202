# SPDX-License-Identifier: Apache-2.0
"""Random plans in random states: each claim about a wait is true by a second, plain definition."""

import re
from typing import Any, Dict, List, Set, Tuple

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from robot_scenario import DOMAIN, OPERATORS

from merlin_explain.claims import Words
from merlin_explain.execution.moment import Moment
from merlin_explain.execution.waiting import waiting
from merlin_pddl.domain_reader import parse_domain

DOMAIN_MODEL = parse_domain(DOMAIN)
ROOMS, DOORS = ("hall", "kitchen"), ("d1", "d2")
STATES = ("waiting", "running", "succeeded")
Literal = Tuple[str, bool]

drives = st.tuples(st.just("drive"), st.sampled_from(DOORS), st.sampled_from(ROOMS), st.sampled_from(ROOMS))
mops = st.tuples(st.just("mop"), st.sampled_from(ROOMS))
steps = st.lists(st.tuples(drives | mops, st.sampled_from(STATES)), min_size=1, max_size=5)
facts = st.sets(
    st.sampled_from(
        [*(f"(at {r})" for r in ROOMS), *(f"(wet {r})" for r in ROOMS), *(f"(open {d})" for d in DOORS)]
    )
)
pairs = st.sets(
    st.tuples(st.integers(0, 4), st.integers(0, 4), st.sampled_from(["", "start", "end"])), max_size=6
)


def needs(words: Tuple[str, ...]) -> Set[Literal]:
    """The literals that a step needs to begin, as the domain has them."""
    if words[0] == "drive":
        return {(f"(at {words[2]})", True), (f"(open {words[1]})", True)}
    return {(f"(at {words[1]})", True), (f"(wet {words[1]})", False)}


def gives(words: Tuple[str, ...], state: str) -> Set[Literal]:
    """What becomes of facts by what is still to come of a step."""
    if words[0] == "mop":
        return {(f"(tidy {words[1]})", True), (f"(wet {words[1]})", True)}
    begin = {(f"(at {words[2]})", False)} if state == "waiting" else set()
    return begin | {(f"(at {words[3]})", True)}


def state_of(plan: List[Any], edges: Set[Tuple[int, int, str]], known: Set[str]) -> Dict[str, Any]:
    shown = {}
    for key, (words, state) in enumerate(plan):
        name, *objects = words
        step = {
            "id": key,
            "text": f"({' '.join(words)})",
            "state": state,
            "start": float(key),
            "duration": 5.0,
        }
        step["parameters"] = [list(pair) for pair in zip(OPERATORS[name], objects)]
        step.update(
            {"began": 1.0} if state != "waiting" else {}, **({"ended": 6.0} if state == "succeeded" else {})
        )
        shown[str(key)] = step
    joined = [
        [str(a), str(b), *([kind] if kind else [])] for a, b, kind in sorted(edges) if a < b < len(plan)
    ]
    objects = {**{room: {"type": "room"} for room in ROOMS}, **{door: {"type": "door"} for door in DOORS}}
    knowledge = {
        "facts": {fact: {} for fact in known},
        "values": {"(battery)": {"value": 20.0}},
        "objects": objects,
    }
    executor = {"request": "/mission-1-5.0", "goals": ["(tidy hall)"], "priority": 0}
    return {
        "meta": {"time": 3.0},
        "now": {"executor": executor},
        "plan": {"steps": shown, "order": list(shown), "edges": joined},
        "knowledge": knowledge,
    }


@given(steps, pairs, facts)
@settings(deadline=None, max_examples=300, suppress_health_check=[HealthCheck.too_slow])
def test_what_is_claimed_is_so_and_each_false_condition_is_named(
    plan: List[Any], edges: Set[Tuple[int, int, str]], known: Set[str]
) -> None:
    moment = Moment(state_of(plan, edges, known), DOMAIN_MODEL)
    asked = next((step for step in moment.steps if step.state == "waiting"), None)
    answer = waiting(moment, "", Words())
    if asked is None:
        assert answer.sentence == "Nothing waits."
        return
    words, named = plan[int(asked.key)][0], set()
    for claim in answer.claims:
        quoted = re.findall(r"“(.*?)”", claim.text)
        if claim.kind == "order":
            first, second = (moment.steps[each.step - 1] for each in claim.evidence)
            kinds = {kind for a, b, kind in edges if (str(a), str(b)) == (first.key, second.key)}
            assert first.text in quoted and first.state != "succeeded" and kinds - {"end"}
            assert first.state == "waiting" or "" in kinds
        elif claim.kind == "condition":
            text = quoted[0]
            literal = (text[5:-1], False) if text.startswith("(not ") else (text, True)
            assert literal in needs(words) and (literal[0] in known) != literal[1]
            named.add(literal)
        else:
            assert claim.kind == "bringer"
            bringer = moment.steps[claim.evidence[0].step - 1]
            assert bringer.state != "succeeded" and bringer.key != asked.key
            assert named & gives(plan[int(bringer.key)][0], bringer.state)
    assert named == {each for each in needs(words) if (each[0] in known) != each[1]}

# SPDX-License-Identifier: Apache-2.0
"""The tree that is shown: a reader that follows its changes, at any pace, gets the same state."""

import json
import math
from typing import Any, Dict, List, Tuple

from hypothesis import given, settings
from hypothesis import strategies as st

from merlin_monitor.state.state_tree import MOST_CHANGES, ChangeSet, StateTree, apply_changes
from merlin_monitor.text.plain_value import LONGEST_TEXT, plain

NAMES = st.sampled_from(["a", "b", "__proto__", "constructor", "<b>", ""])
PATHS = st.lists(NAMES, min_size=1, max_size=3).map(tuple)
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers(-9, 9) | st.floats(allow_nan=True) | st.text(max_size=4),
    lambda inner: st.lists(inner, max_size=2) | st.dictionaries(NAMES, inner, max_size=2),
    max_leaves=4,
)
STEPS = st.lists(
    st.one_of(
        st.tuples(st.just("set"), PATHS, VALUES),
        st.tuples(st.just("remove"), PATHS, st.none()),
        st.tuples(st.just("take"), st.just(()), st.none()),
    ),
    max_size=30,
)


def through_wire(changes: List[list]) -> List[list]:
    return json.loads(json.dumps(changes))


@settings(max_examples=60)
@given(STEPS)
def test_changes_lead_to_the_state_whenever_they_are_taken(steps: List[Tuple[str, Any, Any]]) -> None:
    tree = StateTree(("a", "b"))
    feed = tree.subscribe(lambda: None)
    copy: Dict[str, Any] = json.loads(tree.as_json()[1])
    behind = ChangeSet()  # a page that reads only at the end
    late = json.loads(tree.as_json()[1])
    base, history, own = json.loads(tree.as_json()[1]), [], {}  # a reader of the past, which keeps both
    shared, before = dict(base), tree.as_json()[1]
    for what, path, value in steps:
        if what == "set":
            tree.set(*path, value)
        elif what == "remove":
            tree.remove(*path)
        else:
            changes = feed.take().changes
            behind.merge(changes)
            apply_changes(copy, through_wire(changes.as_list()))
            history.append(through_wire(changes.as_list()))
    taken = feed.take()
    behind.merge(taken.changes)
    apply_changes(copy, through_wire(taken.changes.as_list()))
    apply_changes(late, through_wire(behind.as_list()))
    history.append(through_wire(taken.changes.as_list()))
    kept = json.dumps(history)
    for frame in history:
        apply_changes(shared, frame, own)
    version, text = tree.as_json()
    assert copy == json.loads(text) == late == shared
    assert base == json.loads(before) and json.dumps(history) == kept
    assert taken.version == version


@given(VALUES)
def test_every_value_becomes_json(value: Any) -> None:
    assert json.loads(json.dumps(plain(value), allow_nan=False)) == plain(value)


def test_strange_values_become_text_of_bounded_length() -> None:
    assert plain(float("nan")) is None and plain(math.inf) is None
    assert plain(b"caf\xc3\xa9") == "café"
    assert len(plain("x" * 10_000_000)) == LONGEST_TEXT + 1
    assert plain({1: object})["1"].startswith("<class")


def test_the_same_value_again_is_no_change() -> None:
    tree = StateTree()
    woken: List[int] = []
    feed = tree.subscribe(lambda: woken.append(1))
    assert tree.set("now", "doing", "x") and not tree.set("now", "doing", "x")
    tree.set("now", "doing", "y")
    assert woken == [1], "woken once until the changes are taken"
    assert feed.take().changes.as_list() == [[["now", "doing"], "y"]]
    assert tree.set("now", "doing", "z") and woken == [1, 1]


def test_who_reads_slowly_keeps_a_bounded_set_and_then_gets_everything() -> None:
    tree = StateTree()
    feed = tree.subscribe(lambda: None)
    for number in range(MOST_CHANGES * 3):
        tree.set("facts", str(number), {})
    changes = feed.take().changes
    assert changes.whole and changes.as_list() == []
    for _ in range(MOST_CHANGES * 3):
        tree.set("now", "time", _)
    assert not feed.take().changes.whole


def test_what_was_handed_out_does_not_change_any_more() -> None:
    tree = StateTree()
    feed = tree.subscribe(lambda: None)
    tree.set("plan", "steps", {"1": {"state": "waiting"}})
    changes = feed.take().changes.as_list()
    tree.set("plan", "steps", "1", "state", "running")
    assert changes == [[["plan", "steps"], {"1": {"state": "waiting"}}]]
    copy = tree.get("plan", "steps")
    copy["1"]["state"] = "mine"
    assert tree.get("plan", "steps", "1", "state") == "running"
    assert tree.get("plan", "nothing", default=3) == 3

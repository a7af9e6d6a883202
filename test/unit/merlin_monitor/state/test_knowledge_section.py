# SPDX-License-Identifier: Apache-2.0
"""What the robot knows, from published changes, and read again."""

from typing import Any, Dict, List, Tuple

from hypothesis import given
from hypothesis import strategies as st
from merlin_msgs.msg import KnowledgeChanges
from messages import Reported, changes, fact, thing, value
from rosplan_knowledge_msgs.msg import DomainInequality, ExprBase, ExprComposite, KnowledgeItem

from merlin_monitor.state.knowledge_section import RECENT, Contents, KnowledgeSection
from merlin_monitor.state.state_tree import StateTree
from merlin_monitor.text.fact_text import item_text

NAMES = ["robot_at", "checked", "<script>alert(1)</script>", "__proto__", "ünïcode"]
FACTS = st.builds(fact, st.sampled_from(NAMES), st.sampled_from(["kitchen", "<img src=x>", "__proto__"]))


def section() -> Tuple[StateTree, KnowledgeSection, Reported]:
    tree, reported = StateTree(), Reported()
    return tree, KnowledgeSection(tree, reported), reported


def shown(tree: StateTree) -> Dict[str, Any]:
    knowledge = tree.get("knowledge")
    return {
        "objects": {name: entry["type"] for name, entry in knowledge["objects"].items()},
        "facts": sorted(knowledge["facts"]),
        "values": {name: entry["value"] for name, entry in knowledge["values"].items()},
        "goals": sorted(knowledge["goals"]),
    }


def test_the_beginning_is_no_change() -> None:
    tree, knowledge, reported = section()
    contents = Contents({"kitchen": "poi"}, [fact("robot_at", "kitchen")], [value("d", number=2.0)], [])
    knowledge.replace(contents, "", 0.0, first=True)
    assert shown(tree) == {
        "objects": {"kitchen": "poi"},
        "facts": ["(robot_at kitchen)"],
        "values": {"(d)": 2.0},
        "goals": [],
    }
    assert reported == [] and tree.get("knowledge", "recent") == {}


def test_a_change_says_who_and_when() -> None:
    tree, knowledge, reported = section()
    knowledge.changed(
        changes("/bridge", added=[fact("checked", "kitchen")], goals_added=[fact("checked", "x")]), 12.5
    )
    knowledge.changed(
        changes(
            "/executor",
            version=7,
            changed=[value("battery", number=20.0)],
            removed=[fact("checked", "kitchen")],
        ),
        13.0,
    )
    assert shown(tree)["facts"] == [] and shown(tree)["goals"] == ["(checked x)"]
    entry = {"value": 20.0, "by": "/executor", "at": 13.0, "version": 7}
    assert tree.get("knowledge", "values", "(battery)") == entry
    assert reported.texts == [
        "kitchen checked added and goal x checked added, by /bridge",
        "kitchen checked removed and battery is 20, by /executor",
    ]
    recent = list(tree.get("knowledge", "recent").values())
    assert [(change["sign"], change["text"]) for change in recent][-2:] == [
        ("-", "(checked kitchen)"),
        ("+", "(battery) = 20"),
    ]
    assert [change["version"] for change in recent][-2:] == [7, 7]


def test_reading_again_tells_only_what_differs() -> None:
    tree, knowledge, reported = section()
    knowledge.replace(Contents({}, [fact("a"), fact("b")], [value("n", number=1.0)], []), "", 0.0, True)
    tree_before = tree.version
    knowledge.replace(Contents({}, [fact("a"), fact("b")], [value("n", number=1.0)], []), "", 1.0, False)
    assert tree.version == tree_before
    knowledge.replace(Contents({}, [fact("b"), fact("c")], [value("n", number=2.0)], []), "/x", 2.0, False)
    assert shown(tree)["facts"] == ["(b)", "(c)"] and shown(tree)["values"] == {"(n)": 2.0}
    assert reported.texts == ["a removed, c added and n is 2, by /x"]


@given(
    st.lists(
        st.tuples(st.sampled_from(["added", "removed", "goals_added", "goals_removed", "clear"]), FACTS),
        max_size=25,
    )
)
def test_any_order_of_changes_with_any_names(steps: List[Tuple[str, KnowledgeItem]]) -> None:
    tree, knowledge, _ = section()
    facts, goals = set(), set()
    for what, item in steps:
        message = KnowledgeChanges(client="<b>me</b>", cleared=what == "clear")
        if what == "clear":
            facts.clear()
            goals.clear()
        else:
            setattr(message, what, [item])
            known = goals if what.startswith("goals") else facts
            (known.add if what.endswith("added") else known.discard)(item_text(item))
        knowledge.changed(message, 1.0)
    assert shown(tree)["facts"] == sorted(facts) and shown(tree)["goals"] == sorted(goals)
    assert len(tree.get("knowledge", "recent")) <= RECENT


def test_items_of_every_kind_have_a_text() -> None:
    assert item_text(fact("open", "door", is_negative=True)) == "(not (open door))"
    assert item_text(thing("poi", "kitchen")) == "kitchen"
    text = "(forall (?p - poi) (checked ?p))"
    assert item_text(KnowledgeItem(knowledge_type=KnowledgeItem.EXPRESSION, attribute_name=text)) == text
    number = ExprComposite([ExprBase(expr_type=ExprBase.CONSTANT, constant=3.0)])
    comparison = DomainInequality(DomainInequality.GREATER, number, number, False)
    assert item_text(KnowledgeItem(knowledge_type=KnowledgeItem.INEQUALITY, ineq=comparison)) == "(> 3 3)"
    broken = ExprComposite([ExprBase(expr_type=9, special_type=9)])
    comparison = DomainInequality(0, broken, broken, False)
    assert item_text(KnowledgeItem(knowledge_type=KnowledgeItem.INEQUALITY, ineq=comparison)) == "(> ? ?)"

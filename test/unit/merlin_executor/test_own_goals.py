"""An Executor notes its goals where its successor finds them, and copes with notes that are none."""

import json
from pathlib import Path
from typing import List, Sequence

import pytest
import rospy

from merlin_executor.own_goals import OwnGoals
from merlin_sm.knowledge_client import ADD_GOAL, Update
from merlin_sm.pddl_text import parse_goal, to_pddl


class Knowledge:
    """Goals of a knowledge base."""

    def __init__(self) -> None:
        self.goals: List[str] = []

    def update(self, updates: Sequence[Update]) -> None:
        for update in updates:
            text = to_pddl(update.item)
            if update.kind == ADD_GOAL:
                self.goals.append(text)
            elif text in self.goals:
                self.goals.remove(text)


@pytest.fixture
def knowledge() -> Knowledge:
    return Knowledge()


def own(knowledge: Knowledge, path: Path) -> OwnGoals:
    return OwnGoals(knowledge, str(path))  # type: ignore[arg-type]


def test_a_successor_removes_what_was_left_and_nothing_else(knowledge: Knowledge, tmp_path: Path) -> None:
    knowledge.goals = ["(checked hall)"]
    own(knowledge, tmp_path / "goals").add(parse_goal("(and (checked kitchen) (not (robot_at hall)))"))
    assert len(knowledge.goals) == 3
    assert own(knowledge, tmp_path / "goals").remove_left() == ["(checked kitchen)", "(not (robot_at hall))"]
    assert knowledge.goals == ["(checked hall)"]
    assert own(knowledge, tmp_path / "goals").remove_left() == []


@pytest.mark.parametrize("text", ["", "no json", '{"a": 1}', "7", "null", '"(checked kitchen)"', "\x00\xff"])
def test_a_file_that_holds_no_list_is_ignored(
    text: str, knowledge: Knowledge, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    complaints: List[str] = []
    monkeypatch.setattr(rospy, "logerr", complaints.append)
    (tmp_path / "goals").write_bytes(text.encode("latin-1"))
    assert own(knowledge, tmp_path / "goals").remove_left() == []
    assert bool(complaints) == bool(text)


def test_what_is_noted_and_no_goal_does_not_keep_the_others(
    knowledge: Knowledge, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rospy, "logerr", lambda text: None)
    knowledge.goals = ["(checked kitchen)"]
    (tmp_path / "goals").write_text(json.dumps(["(checked", 7, "(checked kitchen)"]))
    assert own(knowledge, tmp_path / "goals").remove_left() == ["(checked kitchen)"]
    assert knowledge.goals == []


def test_goals_that_cannot_be_noted_are_not_added(knowledge: Knowledge, tmp_path: Path) -> None:
    goals = own(knowledge, tmp_path / "folder" / "goals")
    (tmp_path / "folder" / "goals").unlink()
    (tmp_path / "folder").rmdir()
    with pytest.raises(OSError):
        goals.add(parse_goal("(checked kitchen)"))
    assert knowledge.goals == []
    knowledge.goals = ["(checked kitchen)"]  # somebody else's
    goals.remove()
    assert knowledge.goals == ["(checked kitchen)"]

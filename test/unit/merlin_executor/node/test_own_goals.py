# SPDX-License-Identifier: Apache-2.0
"""An Executor notes its goals where its successor finds them, and copes with damaged notes."""

import json
from pathlib import Path
from typing import List, Optional, Sequence

import pytest
import rospy
from rosplan_knowledge_msgs.msg import KnowledgeItem

from merlin_executor.node.own_goals import OwnGoals
from merlin_planning.knowledge_client import ADD_GOAL, KnowledgeError, Update
from merlin_planning.knowledge_text import parse_goal, to_pddl
from merlin_ros.service_proxy import ServiceUnavailable


class Knowledge:
    """Goals of a knowledge base."""

    def __init__(self) -> None:
        self.texts: List[str] = []
        self.error: Optional[Exception] = None

    def goals(self) -> List[KnowledgeItem]:
        return [item for text in self.texts for item in parse_goal(text)]

    def update(self, updates: Sequence[Update]) -> None:
        if self.error is not None:
            raise self.error
        for update in updates:
            text = to_pddl(update.item)
            if update.kind == ADD_GOAL:
                self.texts.append(text)
            elif text in self.texts:
                self.texts.remove(text)


@pytest.fixture
def knowledge() -> Knowledge:
    return Knowledge()


def own(knowledge: Knowledge, path: Path) -> OwnGoals:
    return OwnGoals(knowledge, str(path))  # type: ignore[arg-type]


def test_a_successor_removes_what_was_left_and_nothing_else(knowledge: Knowledge, tmp_path: Path) -> None:
    knowledge.texts = ["(checked hall)"]
    own(knowledge, tmp_path / "goals").add(parse_goal("(and (checked kitchen) (not (robot_at hall)))"))
    assert len(knowledge.texts) == 3
    assert own(knowledge, tmp_path / "goals").remove_left() == ["(checked kitchen)", "(not (robot_at hall))"]
    assert knowledge.texts == ["(checked hall)"]
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
    knowledge.texts = ["(checked kitchen)"]
    (tmp_path / "goals").write_text(json.dumps(["(checked", 7, "(checked kitchen)"]))
    assert own(knowledge, tmp_path / "goals").remove_left() == ["(checked kitchen)"]
    assert knowledge.texts == []


def test_goals_that_cannot_be_noted_are_not_added(knowledge: Knowledge, tmp_path: Path) -> None:
    goals = own(knowledge, tmp_path / "folder" / "goals")
    (tmp_path / "folder" / "goals").unlink()
    (tmp_path / "folder").rmdir()
    (tmp_path / "folder").touch()
    with pytest.raises(OSError):
        goals.add(parse_goal("(checked kitchen)"))
    assert knowledge.texts == []
    knowledge.texts = ["(checked kitchen)"]  # another client's
    goals.remove()
    assert knowledge.texts == ["(checked kitchen)"]


class Lease:
    """What a knowledge base hears of the leases."""

    def __init__(self) -> None:
        self.held: List[str] = []
        self.heard: List[List[str]] = []

    def hold(self, goal: str) -> None:
        self.held.append(goal)
        self.heard.append(list(self.held))

    def release(self, goal: str) -> None:
        self.held.remove(goal)
        self.heard.append(list(self.held))

    @property
    def texts(self) -> List[str]:
        return [lease.partition(" ")[2] for lease in self.held]


def test_a_lease_names_the_goals_while_they_are_there(knowledge: Knowledge, tmp_path: Path) -> None:
    lease = Lease()
    goals = OwnGoals(knowledge, str(tmp_path / "goals"), lease)  # type: ignore[arg-type]
    goals.add(parse_goal("(checked kitchen)"))
    assert lease.texts == ["(and (checked kitchen))"]
    first = lease.held[0]
    goals.add(parse_goal("(checked hall)"))
    assert lease.texts == ["(and (checked kitchen) (checked hall))"]
    assert first not in lease.held  # a lease that was lost is never held again
    assert all(lease.heard), "the goals were without a lease for a moment"
    goals.remove()
    assert lease.held == []
    assert not goals.left


def test_goals_stay_leased_until_they_are_removed(knowledge: Knowledge, tmp_path: Path) -> None:
    lease = Lease()
    goals = OwnGoals(knowledge, str(tmp_path / "goals"), lease)  # type: ignore[arg-type]
    goals.add(parse_goal("(checked kitchen)"))
    knowledge.error = ServiceUnavailable("hangs")
    with pytest.raises(ServiceUnavailable):
        goals.remove()
    assert goals.left
    assert lease.held
    knowledge.error = None
    goals.remove()
    assert not goals.left
    assert not lease.held
    assert knowledge.texts == []


def test_an_addition_without_an_answer_is_removed_twice(knowledge: Knowledge, tmp_path: Path) -> None:
    goals = own(knowledge, tmp_path / "goals")
    knowledge.error = ServiceUnavailable("hangs")
    with pytest.raises(ServiceUnavailable):
        goals.add(parse_goal("(checked kitchen)"))
    knowledge.error = None
    goals.remove()
    knowledge.texts.append("(checked kitchen)")  # the hung knowledge base goes on with what it was sent
    assert goals.left
    goals.remove()
    assert not goals.left
    assert knowledge.texts == []


def test_what_was_refused_is_not_removed_and_does_not_keep_the_next_request(
    knowledge: Knowledge, tmp_path: Path
) -> None:
    goals = own(knowledge, tmp_path / "goals")
    goals.add(parse_goal("(checked hall)"))
    knowledge.error = KnowledgeError("inf is not a finite number")
    with pytest.raises(KnowledgeError):
        goals.add(parse_goal("(and (checked kitchen) (>= (battery) 3))"))
    assert json.loads((tmp_path / "goals").read_text()) == ["(checked hall)"]
    knowledge.error = None
    goals.remove()
    assert not goals.left and knowledge.texts == []
    knowledge.error = KnowledgeError("inf is not a finite number")
    with pytest.raises(KnowledgeError):
        goals.add(parse_goal("(>= (battery) 3)"))
    assert not goals.left
    goals.remove()  # asks for nothing


def test_the_goals_of_one_request_are_removed_and_those_of_the_others_stay(
    knowledge: Knowledge, tmp_path: Path
) -> None:
    lease = Lease()
    goals = OwnGoals(knowledge, str(tmp_path / "goals"), lease)  # type: ignore[arg-type]
    goals.add(parse_goal("(and (checked kitchen) (checked hall))"))
    goals.keep(parse_goal("(and (Checked hall) (checked bath))"))
    assert knowledge.texts == ["(checked hall)"]
    assert lease.texts == ["(and (checked hall))"]
    assert all(lease.heard), "the goals were without a lease for a moment"
    assert own(knowledge, tmp_path / "goals").remove_left() == ["(checked hall)"]


def test_goals_whose_addition_had_no_answer_are_not_removed_one_by_one(
    knowledge: Knowledge, tmp_path: Path
) -> None:
    goals = own(knowledge, tmp_path / "goals")
    knowledge.error = ServiceUnavailable("hangs")
    with pytest.raises(ServiceUnavailable):
        goals.add(parse_goal("(and (checked kitchen) (checked hall))"))
    knowledge.error = None
    goals.keep(parse_goal("(checked hall)"))
    goals.remove()
    assert goals.left, "they may come true later"

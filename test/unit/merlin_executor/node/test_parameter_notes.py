# SPDX-License-Identifier: Apache-2.0
"""Notes of goals on the parameter server: the last word counts, and a call to the master delays no goal."""

import threading
from typing import Any, Dict, List
from unittest import mock

import pytest
import rospy

from merlin_executor.node import own_goals
from merlin_executor.node.own_goals import OwnGoals, ParameterNotes
from merlin_planning.knowledge_text import parse_goal
from merlin_ros.master.master_link import MasterSilent
from merlin_test import LONG


class Master:
    """A parameter server that can be slowed down."""

    def __init__(self) -> None:
        self.params: Dict[str, Any] = {}
        self.answers = threading.Event()
        self.answers.set()
        self.asked = threading.Event()
        self.written = threading.Condition()
        self.silent = False
        self.words: List[Any] = []

    def set_param(self, name: str, value: Any) -> None:
        self.asked.set()
        assert self.answers.wait(LONG)
        with self.written:
            self.written.notify_all()
            if self.silent:
                raise MasterSilent("no answer")
            self.params[name] = value
            self.words.append(value)

    def get_param(self, name: str, default: Any) -> Any:
        return self.params.get(name, default)

    def wait_for(self, value: List[str]) -> None:
        with self.written:
            assert self.written.wait_for(lambda: value in self.params.values(), LONG)


@pytest.fixture
def master(monkeypatch: pytest.MonkeyPatch) -> Master:
    made = Master()
    monkeypatch.setattr(own_goals, "set_param", made.set_param)
    monkeypatch.setattr(own_goals, "get_param", made.get_param)
    return made


def test_what_was_written_is_read(master: Master) -> None:
    notes = ParameterNotes("/notes")
    assert notes.read() == []
    notes.write(["(checked kitchen)"])
    assert ParameterNotes("/notes").read() == ["(checked kitchen)"]


def test_the_last_word_comes_last(master: Master) -> None:
    notes = ParameterNotes("/notes")
    master.answers.clear()
    notes.write_soon(["(checked kitchen)"])
    assert master.asked.wait(LONG)
    notes.write_soon(["(checked hall)"])
    notes.write_soon([])
    master.answers.set()
    notes.write(["(checked bathroom)"])
    assert notes.read() == ["(checked bathroom)"]
    notes.write_soon([])
    master.wait_for([])


def test_of_words_that_wait_only_the_last_is_written(master: Master) -> None:
    notes = ParameterNotes("/notes")
    master.answers.clear()
    for place in ("kitchen", "hall", "bathroom"):
        notes.write_soon([f"(checked {place})"])
        assert master.asked.wait(LONG)
    master.answers.set()
    master.wait_for(["(checked bathroom)"])
    assert ["(checked hall)"] not in master.words


def test_the_caller_learns_that_its_word_was_not_written(master: Master) -> None:
    master.silent = True
    with pytest.raises(MasterSilent, match="no answer"):
        ParameterNotes("/notes").write(["(checked kitchen)"])


def test_a_silent_master_is_logged_and_the_next_word_written(
    master: Master, monkeypatch: pytest.MonkeyPatch
) -> None:
    logged = threading.Event()
    monkeypatch.setattr(rospy, "logwarn_throttle", lambda *_: logged.set())
    notes = ParameterNotes("/notes")
    master.silent = True
    notes.write_soon(["(checked kitchen)"])
    assert logged.wait(LONG)
    master.silent = False
    notes.write_soon([])
    master.wait_for([])


def own(watched: bool) -> OwnGoals:
    return OwnGoals(mock.Mock(), "", mock.Mock(watched=watched))


def test_goals_whose_lease_is_watched_do_not_wait_for_the_master(master: Master) -> None:
    master.answers.clear()
    goals = own(watched=True)
    goals.add(parse_goal("(checked kitchen)"))
    goals.remove()
    master.answers.set()
    master.wait_for([])


def test_without_a_watcher_the_note_comes_before_the_goal(master: Master) -> None:
    own(watched=False).add(parse_goal("(checked kitchen)"))
    assert master.params[own_goals.PARAMETER] == ["(checked kitchen)"]

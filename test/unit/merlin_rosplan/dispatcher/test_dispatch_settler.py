# SPDX-License-Identifier: Apache-2.0
"""What an interface that has died left open is closed, whatever the knowledge base does meanwhile."""

import threading
from types import SimpleNamespace
from typing import Any, List

import pytest
from merlin_msgs.msg import OpenExecution

from merlin_planning import execution_journal
from merlin_rosplan.dispatch.dispatch_schedule import PlannedAction
from merlin_rosplan.dispatcher import dispatch_settler
from merlin_rosplan.dispatcher.dispatch_settler import DispatchSettler
from merlin_test import LONG

ACTION = PlannedAction(7, "navigate", (("to", "kitchen"),), 1.0, 0.0)


class Base:
    """A knowledge base with an open execution.

    :ivar services: those that it offers.
    """

    def __init__(self) -> None:
        self.services: List[str] = []
        self.asked, self.interrupted = threading.Event(), threading.Event()

    def answer(self, service: str) -> Any:
        if service == "apply_effects":
            self.interrupted.set()
        return SimpleNamespace(executions=[OpenExecution(token="3/7/x")], success=True)


@pytest.fixture
def base(monkeypatch: pytest.MonkeyPatch) -> Base:
    made = Base()

    class Proxy:
        def __init__(self, name: str, *_: Any, **__: Any) -> None:
            self.name = name
            self._service = name.rpartition("/")[2]

        def offered(self) -> bool:
            found = self._service in made.services
            made.asked.set()
            return found

        available = offered

        def __call__(self, **_: Any) -> Any:
            return made.answer(self._service)

    monkeypatch.setattr(execution_journal, "ServiceProxy", Proxy)
    monkeypatch.setattr(dispatch_settler, "RETRY", 0.01)
    return made


def test_an_execution_is_closed_when_the_knowledge_base_is_there_again(base: Base) -> None:
    settler = DispatchSettler("/kb", lambda operator: None, 1.0)
    settler.settle(3, [ACTION])
    assert base.asked.wait(LONG)
    base.services = ["executions", "apply_effects", "update_array"]
    assert base.interrupted.wait(LONG)
    settler.shutdown()


def test_a_knowledge_base_without_executions_is_asked_for_none(base: Base) -> None:
    base.services = ["update_array"]
    assert not execution_journal.ExecutionJournal("/kb", 1.0).offered()

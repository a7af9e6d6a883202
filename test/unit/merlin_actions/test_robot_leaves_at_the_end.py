# SPDX-License-Identifier: Apache-2.0
"""A robot leaves while its action ends: the answer names it, and comes once the knowledge says so.

The next plan is made at the answer. It must not be given the robot once more.
"""

from typing import Any, List, Optional

import pytest
from diagnostic_msgs.msg import KeyValue
from rosplan_dispatch_msgs.msg import ActionDispatch
from rosplan_knowledge_msgs.msg import DomainFormula

from merlin_actions import action_interface, merlin_action
from merlin_actions.core.ending import Ending
from merlin_actions.core.execution import Execution
from merlin_actions.merlin_action import MerlinAction

OUT = "robot ann was taken out by its operator"


class Servers:
    """Those of robots, one of which leaves after the first question."""

    def __init__(self, log: List[str]) -> None:
        self._log = log
        self._asked = 0

    def why_not(self, robot: str, *_: Any) -> str:
        self._asked += 1
        return OUT if self._asked > 1 else ""

    def wait_published(self, robot: str) -> None:
        self._log.append(f"published {robot}")


class Drive(MerlinAction):
    def __init__(self, log: List[str]) -> None:
        super().__init__("drive")
        self._log = log

    def ready(self, execution: Execution) -> Optional[Ending]:
        return Ending(False, "/ann/actions/drive aborted", begun=False)

    def _answer(self, key: Any, ending: Optional[Ending] = None) -> None:
        if ending is not None:
            self._log.append(f"answered {ending.robot}: {ending.reason}")


def test_the_answer_waits_for_the_knowledge(monkeypatch: pytest.MonkeyPatch) -> None:
    operator = type("Details", (), {"formula": DomainFormula(name="drive")})
    knowledge = type("Knowledge", (), {"name": "/kb", "operator": lambda self, name: operator})
    log: List[str] = []
    monkeypatch.setattr(action_interface, "knowledge_client", lambda name: knowledge())
    monkeypatch.setattr(action_interface, "effects_of", lambda details, knowledge: None)
    monkeypatch.setattr(action_interface.rospy, "loginfo", lambda *_: None)
    monkeypatch.setattr(merlin_action, "ActionServers", lambda *_: Servers(log))
    drive = Drive(log)
    monkeypatch.setattr(
        drive, "_owners", type("Owners", (), {"forget": lambda self, number: None})(), raising=False
    )
    execution = Execution(ActionDispatch(plan_id=1, action_id=2, name="drive"), [KeyValue("r", "ann")])
    execution.lane = "ann"
    drive._live(execution)
    assert log == ["published ann", f"answered ann: {OUT}"]

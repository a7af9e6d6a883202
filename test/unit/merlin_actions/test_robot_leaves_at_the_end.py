# SPDX-License-Identifier: Apache-2.0
"""A robot leaves while its action ends: the answer names it, and comes once the knowledge says so.

The next plan is made at the answer. It must not be given the robot once more.
"""

import time
from typing import Any, List, Optional, Type

import pytest
from fakes.dispatched import Dispatcher
from rosplan_dispatch_msgs.msg import ActionFeedback

from merlin_actions import merlin_action
from merlin_actions.core.ending import Ending
from merlin_actions.core.execution import Execution
from merlin_actions.core.robot_book import RobotChange
from merlin_actions.merlin_action import MerlinAction
from merlin_test import LONG

OUT = "robot ann was taken out by its operator"


class Servers:
    """Those of robots, one of which leaves after the first question."""

    def __init__(self, log: List[str]) -> None:
        self._log = log
        self._asked = 0
        self.robots = self

    def robot(self, binding: Any) -> str:
        return "ann"

    def why_not(self, robot: str, *_: Any) -> str:
        self._asked += 1
        return OUT if self._asked > 1 else ""

    def wait_published(self, robot: str) -> None:
        self._log.append(f"published {robot}")


class Drive(MerlinAction):
    def ready(self, execution: Execution) -> Optional[Ending]:
        return Ending(False, "/ann/actions/drive aborted", begun=False)


class Waiting(MerlinAction):
    def ready(self, execution: Execution) -> Optional[Ending]:
        execution.cancelled.wait(LONG)
        return Ending(False, execution.cancel_reason, begun=False)


class Staying(Servers):
    """Those of robots, none of which leaves."""

    def why_not(self, robot: str, *_: Any) -> str:
        return ""


def answers(monkeypatch: pytest.MonkeyPatch, servers: Type[Servers]) -> List[str]:
    """What a failure of the robot ann is answered with, and what was waited for before."""
    log: List[str] = []
    dispatcher = Dispatcher(monkeypatch)
    monkeypatch.setattr(merlin_action, "ActionServers", lambda *_: servers(log))

    def note(topic: str, message: Any) -> None:
        if isinstance(message, ActionFeedback) and message.status == ActionFeedback.ACTION_FAILED:
            log.append(", ".join(f"{each.key}: {each.value}" for each in message.information))

    dispatcher.topics.before = note
    drive = Drive("navigate")
    drive.start()
    dispatcher.wait_announced()
    dispatcher.dispatch(2)
    dispatcher.end()
    drive.shutdown()
    return log


def test_the_answer_waits_for_the_knowledge(monkeypatch: pytest.MonkeyPatch) -> None:
    assert answers(monkeypatch, Servers) == ["published ann", f"reason: {OUT}, robot: ann"]


def test_the_answer_of_a_robot_that_stays_says_what_is_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    (said,) = answers(monkeypatch, Staying)
    assert said == "reason: /ann/actions/drive aborted, of_robot: (navigate hall)"


def test_what_a_robot_did_before_its_action_came_does_not_fail_that(monkeypatch: pytest.MonkeyPatch) -> None:
    dispatcher = Dispatcher(monkeypatch)
    monkeypatch.setattr(merlin_action, "ActionServers", lambda *_: Staying([]))
    drive = Waiting("navigate")
    drive.start()
    dispatcher.wait_announced()
    earlier = RobotChange("ann", False, "the host of robot ann was restarted", at=time.monotonic())
    dispatcher.dispatch(2)
    (execution,) = drive.executions()
    drive.robot_changed(earlier)
    assert not execution.cancelled.is_set()
    drive.robot_changed(RobotChange("ann", False, OUT, True, at=time.monotonic()))
    assert execution.cancelled.is_set() and execution.cancel_reason == OUT
    dispatcher.end()
    drive.shutdown()

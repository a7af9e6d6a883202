# SPDX-License-Identifier: Apache-2.0
"""An action interface without ROS, and what its dispatcher says and hears."""

from queue import Empty
from types import SimpleNamespace
from typing import Any, Dict, List, Optional, Tuple

import pytest
import rospy
from diagnostic_msgs.msg import KeyValue
from fakes.topics import Topics
from merlin_msgs.msg import DispatchStatus, Lease, RunningAction
from rosplan_dispatch_msgs.msg import ActionDispatch, ActionFeedback
from rosplan_knowledge_msgs.msg import DomainFormula

from merlin_actions import action_interface
from merlin_test import LONG

DISPATCHER = "/rosplan_plan_dispatcher"
FORMULA = DomainFormula(name="navigate", typed_parameters=[KeyValue("to", "poi")])


class Dispatcher:
    """Takes the place of the nodes around an action interface; to be made before it.

    :ivar now: running time, s.
    :ivar connected: whether the interface has a connection to it.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch, effects: Any = None, connected: bool = True) -> None:
        self.topics = Topics(monkeypatch)
        self.now = 0.0
        self.connected = connected
        nothing = SimpleNamespace(open=lambda opening: None, close=lambda *_: None)
        knowledge = SimpleNamespace(name="/kb", operator=lambda name: SimpleNamespace(formula=FORMULA))
        for name, made in (
            ("LATCH_GRACE", 0.0),
            ("running_time", lambda: self.now),
            ("knowledge_client", lambda name: knowledge),
            ("effects_of", lambda details, knowledge: effects or nothing),
            ("settle_left", lambda knowledge, operator: []),
            ("connected_peers", lambda subscriber: {DISPATCHER} if self.connected else set()),
            ("get_param", lambda name, default: default),
            ("master_is_lost", lambda: False),
        ):
            monkeypatch.setattr(action_interface, name, made)
        for level in ("loginfo", "logwarn", "logerr"):
            monkeypatch.setattr(rospy, level, lambda *_: None)

    def wait_announced(self) -> None:
        """Waits until the interface has announced itself: it is connected then."""
        assert self.topics.published("/kb/pddl_action_parameters").get(timeout=LONG)

    def dispatch(
        self,
        action: int,
        plan: int = 7,
        name: str = "navigate",
        header: Optional[Dict[str, str]] = None,
    ) -> None:
        """Dispatches ``(navigate hall)``, or cancels it; returns when the interface has read it."""
        message = ActionDispatch(
            plan_id=plan, action_id=action, name=name, parameters=[KeyValue("to", "hall")]
        )
        self.topics.send(f"{DISPATCHER}/action_dispatch", message, header)

    def waits_for(self, *actions: int) -> None:
        """Says for which actions of plan 7 it waits."""
        running = [RunningAction(plan_id=7, action_id=action) for action in actions]
        self.topics.send(f"{DISPATCHER}/dispatch_status", DispatchStatus(running=running))

    def lease(self, held: List[str], suspended: List[str]) -> None:
        """Names the executions that it wants."""
        lease = Lease(owner=DISPATCHER, life="a", held=held, suspended=suspended)
        self.topics.send(f"{DISPATCHER}/lease", lease, {"callerid": DISPATCHER})

    @property
    def _feedback(self) -> Any:
        return self.topics.published(f"{DISPATCHER}/action_feedback")

    def begun(self) -> List[Tuple[int, int]]:
        """Plan and action of what was accepted since the last look."""
        found = []
        try:
            while True:
                answer: ActionFeedback = self._feedback.get_nowait()
                if answer.status == ActionFeedback.ACTION_ENABLED:
                    found.append((answer.plan_id, answer.action_id))
        except Empty:
            return found

    def end(self) -> ActionFeedback:
        """The next final answer."""
        while True:
            answer: ActionFeedback = self._feedback.get(timeout=LONG)
            if answer.status != ActionFeedback.ACTION_ENABLED:
                return answer

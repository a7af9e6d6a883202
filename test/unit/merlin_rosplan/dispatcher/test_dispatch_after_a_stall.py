# SPDX-License-Identifier: Apache-2.0
"""A stall of a dispatcher or of a network fails no plan: what comes late is handled before a limit passes."""

import socket
import time
from types import SimpleNamespace
from typing import Any, Iterator, List

import pytest
import rospy
from dispatch_world import LIGHT, Run, World, actions
from fakes.topics import Topics
from rosplan_dispatch_msgs.msg import ActionFeedback

from merlin_pddl.breakpoints import Breakpoints
from merlin_ros import deadline
from merlin_rosplan.dispatch.dispatch_environment import (
    DispatchState,
    FeedbackStatus,
    KnowledgeChanged,
    Tick,
)
from merlin_rosplan.dispatch.dispatch_graph import SequentialSchedule
from merlin_rosplan.dispatch.operator_model import PlanTerm
from merlin_rosplan.dispatcher.dispatch_topics import DispatchTopics
from merlin_test import LONG

BURNING = PlanTerm("burning", ("o0",))


class Stalled(World):
    """The world of a dispatcher whose limits are those of the node."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        super().__init__(LIGHT)
        self._missed = 0.0
        self._parts: List[Any] = []
        clock = SimpleNamespace(monotonic=lambda: time.monotonic() + self._missed)
        monkeypatch.setattr(deadline, "time", clock)
        monkeypatch.setattr(rospy.Time, "now", rospy.Time)
        Topics(monkeypatch)
        component: Any = SimpleNamespace(
            scope="/dispatcher",
            knowledge_base="/kb",
            closed=False,
            param=lambda name, default: default,
            resolve=lambda name: f"/dispatcher/{name}",
            own=self._own,
            publisher=rospy.Publisher,
            subscriber=rospy.Subscriber,
        )
        ignored: Any = SimpleNamespace
        self.topics = DispatchTopics(component, ignored, False, ignored, ignored, ignored, Breakpoints())
        self.deadline = self.topics.deadline

    def _own(self, part: Any) -> Any:
        self._parts.append(part)
        return part

    def end(self) -> None:
        """The dispatcher ends; else its leases last as long as the process."""
        for part in self._parts:
            part.shutdown()

    def stall(self) -> None:
        """The process is stopped for longer than any limit."""
        self._missed += 1000.0

    def seconds_silent(self, operator: str) -> Any:
        self.note("looked", actions(operator)[0])
        return super().seconds_silent(operator)


@pytest.fixture
def world(monkeypatch: pytest.MonkeyPatch) -> Iterator[Stalled]:
    made = Stalled(monkeypatch)
    yield made
    made.end()


def test_an_action_that_ended_meanwhile_has_succeeded(world: Stalled) -> None:
    run = Run(world, SequentialSchedule(actions("light")))
    world.wait("action", 0)
    run.feedback(0, FeedbackStatus.ENABLED)
    answers = 1
    for facts in {BURNING}, set(), set():  # its start effects, its end effects, and once they were seen
        world.facts = facts
        answers += 1
        run.dispatch.put(KnowledgeChanged())
        world.wait_answers(answers)
    world.stall()
    run.dispatch.put(KnowledgeChanged())  # it is read before the end of the action
    world.wait_answers(answers + 1)
    run.feedback(0, FeedbackStatus.SUCCEEDED)
    report = run.report()
    assert report.success, report.reason


def test_an_action_that_was_taken_meanwhile_is_not_given_up(world: Stalled) -> None:
    run = Run(world, SequentialSchedule(actions("light")))
    world.wait("action", 0)
    world.stall()
    run.dispatch.put(Tick())
    world.wait("looked", 0)
    run.feedback(0, FeedbackStatus.ENABLED)
    run.feedback(0, FeedbackStatus.SUCCEEDED)
    report = run.report()
    assert report.success, report.reason


def test_an_action_that_was_cancelled_and_stopped_meanwhile_has_answered(world: Stalled) -> None:
    run = Run(world, SequentialSchedule(actions("light")))
    world.wait("action", 0)
    run.dispatch.cancel()
    with world.changed_event:
        assert world.changed_event.wait_for(lambda: world.reports[-1].state == DispatchState.CANCELLING, LONG)
    world.stall()
    world.published.clear()
    run.dispatch.put(Tick())
    world.wait("looked", 0)
    run.feedback(0, FeedbackStatus.FAILED)
    assert not run.report().unanswered


def link(end: socket.socket, address: str) -> Any:
    return SimpleNamespace(socket=end, endpoint_id=address, header={"callerid": "/painter"})


def test_an_interface_whose_connection_was_cut_and_made_anew_is_still_there(world: Stalled) -> None:
    ours, theirs = socket.socketpair()
    with ours, theirs:
        painter = link(ours, "http://painter:4000/")
        topic: Any = SimpleNamespace(impl=SimpleNamespace(connections=[painter]))
        (paint,) = actions("paint")
        message = ActionFeedback(action_id=paint.id)
        message._connection_header = painter.header
        world.topics.taken(message, topic)
        assert not world.topics.has_left(paint)
        topic.impl.connections = []
        assert world.topics.has_left(paint)
        topic.impl.connections = [link(ours, "http://painter:4000/")]
        assert not world.topics.has_left(paint)
        topic.impl.connections = [link(ours, "http://painter:4001/")]  # of its next life
        assert world.topics.has_left(paint)

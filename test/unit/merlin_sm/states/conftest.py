# SPDX-License-Identifier: Apache-2.0
"""The server of the states, and the guard that they ask."""

import contextlib
import threading
from types import SimpleNamespace
from typing import Any, Iterator, List

import pytest
from fakes.action_server import Server

from merlin_sm.states import action_state, navigation
from merlin_sm.states.navigation import POINTS_PARAM

POINTS = {"kitchen": {"x": 1.0, "y": 2.0, "yaw": 0.0}, "broken": {"x": 1.0, "y": "?"}}


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Server:
    made = Server()
    monkeypatch.setattr(action_state, "shared_client", lambda *_: made)
    monkeypatch.setattr(action_state, "goal_class", lambda _: object)
    monkeypatch.setattr(action_state, "check_message", lambda *_: None)
    followers: List[Any] = []
    follows = threading.Event()

    @contextlib.contextmanager
    def followed(take: Any) -> Iterator[None]:
        followers.append(take)
        follows.set()
        yield
        follows.clear()
        followers.remove(take)

    guard = SimpleNamespace(
        wake=lambda: None,
        names=lambda server: False,
        followed=followed,
        followers=followers,
        follows=follows,
        why_not=lambda preempted, server: "",
        mark=lambda: None,
        why_unmoved=lambda mark, server: "",
    )
    monkeypatch.setattr(action_state, "shared_guard_watch", lambda: guard)
    monkeypatch.setattr(navigation, "get_param", lambda name, default: name == POINTS_PARAM and POINTS)
    made.guard = guard
    return made

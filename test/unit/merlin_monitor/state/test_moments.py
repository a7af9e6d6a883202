# SPDX-License-Identifier: Apache-2.0
"""The moment of an event shows what the event is about, however close together things come."""

import json
import time
import zlib
from typing import Any, List

import pytest

from merlin_monitor.history.history_file import WallClock
from merlin_monitor.state.history_store import Frames
from merlin_monitor.state.state_tree import StateTree


def test_no_two_readings_of_the_clock_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = WallClock()
    monkeypatch.setattr(time, "monotonic", lambda: 5.0)
    read = [clock() for _ in range(1000)]
    assert read == sorted(set(read))


def test_the_frame_of_an_event_is_no_earlier_one(monkeypatch: pytest.MonkeyPatch) -> None:
    began = time.monotonic()
    at = {"now": began}
    clock = WallClock()
    monkeypatch.setattr(time, "monotonic", lambda: at["now"])
    tree = StateTree(("now",))
    frames = Frames(tree, clock, lambda: None)
    tree.set("now", "doing", "what was before")
    at["now"] = began + 0.3001
    before = frames.next(False)
    tree.set("now", "doing", "what it is about")
    at["now"] = began + 0.3004
    event = clock()
    after = frames.next(True)
    assert before is not None and after is not None
    unpack = zlib.decompressobj()
    read: List[Any] = [json.loads(unpack.decompress(frame.data)) for frame in (before, after)]
    shown = next(changes for wall, _, changes, _ in read if wall >= event)
    assert shown == [[["now", "doing"], "what it is about"]]

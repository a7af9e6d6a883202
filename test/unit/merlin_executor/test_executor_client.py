"""Requests that two threads send at the same time are both known to their client."""

import threading
from types import SimpleNamespace
from typing import Any, Callable, List

import pytest

from merlin_executor import executor_client
from merlin_executor.executor_client import MerlinExecutorClient

LONG = 60.0


class Request:
    """A request that has not ended; something happens when that is asked for the first time."""

    def __init__(self) -> None:
        self.cancelled = False
        self.asked: Callable[[], None] = lambda: None

    @property
    def done(self) -> bool:
        asked, self.asked = self.asked, lambda: None
        asked()
        return False

    def cancel(self) -> None:
        self.cancelled = True


def test_all_are_cancelled(monkeypatch: pytest.MonkeyPatch) -> None:
    sent: List[Request] = []

    def request(*_: Any) -> Request:
        sent.append(Request())
        return sent[-1]

    monkeypatch.setattr(executor_client, "ActionClient", lambda *_: SimpleNamespace())
    monkeypatch.setattr(executor_client, "ExecutorRequest", request)
    client = MerlinExecutorClient(knowledge_base=None)
    client.send("(checked hall)")
    other = threading.Thread(target=client.send, args=["(checked door)"], daemon=True)
    sent[0].asked = other.start  # another thread begins while this one takes the next request down
    client.send("(checked kitchen)")
    other.join(LONG)
    client.cancel_all()
    assert [request.cancelled for request in sent] == [True] * 3

"""An action interface announces itself to each new subscriber at once."""

import threading
from unittest import mock

import pytest

from merlin_actions import action_interface
from merlin_actions.action_interface import ActionInterface
from merlin_ros.publishing import Subscribed

LONG = 60.0


def test_a_new_subscriber_does_not_wait_for_the_next_period(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(action_interface, "ANNOUNCE_PERIOD", 600.0)
    monkeypatch.setattr(action_interface, "LATCH_GRACE", 0.0)
    monkeypatch.setattr(action_interface, "running_time", lambda: 0.0)
    monkeypatch.setattr(action_interface, "connected_peers", lambda _: {"/dispatcher"})
    told = threading.Semaphore(0)
    interface = mock.Mock(_stopped=threading.Event(), _newcomers=Subscribed(), _changed=threading.Condition())
    interface._announcements.publish.side_effect = lambda _: told.release()
    thread = threading.Thread(target=ActionInterface._announce, args=(interface,), daemon=True)
    thread.start()
    assert told.acquire(timeout=LONG)  # the period begins
    interface._newcomers.peer_subscribe("/topic", None, None)
    assert told.acquire(timeout=LONG)
    interface._stopped.set()
    interface._newcomers.there.set()
    thread.join(LONG)
    assert not thread.is_alive()

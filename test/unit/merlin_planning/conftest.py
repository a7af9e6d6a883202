# SPDX-License-Identifier: Apache-2.0
"""A dispatcher, its topics, services and action server, as a client of it sees them; without a master."""

import threading
import time
from types import SimpleNamespace
from typing import Any, Callable, Dict, List

import pytest
import rospy
from merlin_msgs.msg import DispatchStatus

from merlin_planning import dispatch_client, over_rosplan
from merlin_planning.dispatch_client import DispatchClient
from merlin_ros import deadline
from merlin_ros.actions.client_goal import ClientGoal
from merlin_ros.actions.lease import LeaseChange, LeaseState
from merlin_ros.service_proxy import ServiceUnavailable


class DispatcherWorld:
    """What a test does to a client, and what the client has done."""

    def __init__(self) -> None:
        self.calls: List[str] = []
        self.heard: Dict[str, Callable[[Any], None]] = {}  # topic -> the client's callback
        self.changed: Callable[[LeaseChange], None] = lambda change: None
        self.held: List[str] = []
        self.owners: List[str] = []
        self.published = ["/dispatcher/plan_graph"]
        self.cancelled = threading.Event()
        self.there = self.takes_cancel = True
        self.passed = 0.0  # s that the clock is ahead
        self.on_dispatch: Callable[[Callable[[object], None]], None] = lambda ended: None
        self.on_call: Callable[[], Any] = lambda: None  # of dispatch_plan
        self.on_cancel: Callable[[], None] = lambda: None
        self.on_exchange: Callable[..., Any] = lambda **fields: SimpleNamespace(refused="")
        self.on_look: Callable[[], None] = lambda: None

    def client(self, **options: Any) -> DispatchClient:
        """A client of the dispatcher ``/dispatcher``."""
        return DispatchClient("/dispatcher", "/kb", **options)

    def status(self, state: int) -> None:
        """The dispatcher publishes its status."""
        self.heard["/dispatcher/dispatch_status"](DispatchStatus(state=state))

    def owner(self, name: str) -> None:
        """A node renews its lease of what is dispatched."""
        self.owners.append(name)

    def running_time(self) -> float:
        return time.monotonic() + self.passed

    def service(self, name: str, *_: Any, **__: Any) -> Any:
        world = self

        class Service:
            @property
            def connected(self) -> bool:
                world.on_look()
                return world.there

            def available(self) -> bool:
                return world.there

            def __call__(self, **fields: Any) -> Any:
                world.calls.append(name.rsplit("/", 1)[-1])
                if fields:
                    return world.on_exchange(**fields)
                if name.endswith("dispatch_plan"):
                    return world.on_call()
                if name.endswith("cancel_dispatch"):
                    world.on_cancel()
                    if not world.takes_cancel:
                        raise ServiceUnavailable("it does not answer")

        return Service()

    def server(self, *_: Any) -> Any:
        def cancel() -> None:
            self.calls.append("cancel of the goal")
            self.cancelled.set()

        def send(goal: Any, ended: Callable[[ClientGoal], None], owner: Any = None) -> Any:
            self.calls.append("goal")
            self.on_dispatch(ended)
            return SimpleNamespace(cancel=cancel, id="goal 1")

        return SimpleNamespace(
            wait_for_server=lambda *_: True,
            missing="",
            send=send,
            give_up=lambda goal, why: self.calls.append("given up"),
            hand_over=lambda goal, owner: self.calls.append(f"{goal.id} for {owner}"),
        )

    def watch(self, topic: str, *changed: Callable[[LeaseChange], None]) -> Any:
        if not changed:
            return SimpleNamespace(owners=self.owners)
        (self.changed,) = changed
        return SimpleNamespace(beside=lambda goal: self.held)

    def lost(self, **fields: Any) -> None:
        """The lease of the plan changes: by default the dispatcher has been silent for long."""
        change = LeaseChange("7/plan", LeaseState.LOST, "its client has been silent for 3.1 s")
        self.changed(change._replace(**fields))


@pytest.fixture
def dispatcher(monkeypatch: pytest.MonkeyPatch) -> DispatcherWorld:
    world = DispatcherWorld()

    def subscribe(topic: str, kind: type, callback: Callable[[Any], None], **_: Any) -> Any:
        world.heard[topic] = callback
        return object()

    monkeypatch.setattr(rospy, "Subscriber", subscribe)
    monkeypatch.setattr(rospy, "Publisher", lambda *_, **__: None)
    monkeypatch.setattr(rospy, "resolve_name", lambda name: name)
    monkeypatch.setattr(rospy, "get_name", lambda: "/me")
    monkeypatch.setattr(rospy, "is_shutdown", lambda: False)
    monkeypatch.setattr(rospy, "logwarn", lambda _: None)
    for module in (deadline, dispatch_client):
        monkeypatch.setattr(module, "running_time", world.running_time)
    for module in (dispatch_client, over_rosplan):
        monkeypatch.setattr(module, "ServiceProxy", world.service)
    monkeypatch.setattr(dispatch_client, "ActionClient", world.server)
    monkeypatch.setattr(dispatch_client, "LeaseWatch", world.watch)
    monkeypatch.setattr(over_rosplan, "subscribe", subscribe)
    monkeypatch.setattr(
        over_rosplan,
        "bounded_master",
        lambda: SimpleNamespace(getPublishedTopics=lambda _: [(each, "") for each in world.published]),
    )
    return world


class Dispatch:
    """A dispatch in a thread of its own; `interrupt` is what its caller would call."""

    def __init__(self, client: DispatchClient, **options: Any) -> None:
        self._results: List[Any] = []
        self.interrupt: Callable[[], None] = lambda: None
        self._thread = threading.Thread(
            target=lambda: self._results.append(client.dispatch(self._keep, **options)), daemon=True
        )
        self._thread.start()

    def _keep(self, interrupt: Any) -> None:
        self.interrupt = interrupt or self.interrupt

    def result(self) -> Any:
        """Waits for the end."""
        self._thread.join(60.0)
        return self._results[0]


@pytest.fixture
def dispatching() -> Callable[..., Dispatch]:
    """Begins a dispatch."""
    return Dispatch

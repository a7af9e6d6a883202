"""A watch of leases goes on whatever is done with a change; so does a client whatever is done with an end."""

import threading
from types import SimpleNamespace
from typing import Any, Iterator, List, Set

import pytest
from actionlib_msgs.msg import GoalID, GoalStatus
from merlin_msgs.msg import Lease

from merlin_ros.actions import client_goal, lease_watch
from merlin_ros.actions.client_goal import ClientGoal
from merlin_ros.actions.lease import LeaseState
from merlin_ros.actions.lease_watch import LeaseWatch

LONG = 60.0


@pytest.fixture
def logged(monkeypatch: pytest.MonkeyPatch) -> Iterator[List[str]]:
    texts: List[str] = []
    ends = threading.Event()
    subscriber = SimpleNamespace(unregister=lambda: None)
    rospy = SimpleNamespace(
        resolve_name=lambda name: f"/{name}",
        Subscriber=lambda *_, **__: subscriber,
        is_shutdown=ends.is_set,
        logerr=texts.append,
    )
    monkeypatch.setattr(lease_watch, "rospy", rospy)
    monkeypatch.setattr(lease_watch, "connected_peers", lambda subscriber: {"/a", "/b"})
    monkeypatch.setattr(client_goal.rospy, "logerr", texts.append)
    yield texts
    ends.set()


def test_a_change_that_cannot_be_dealt_with_hides_no_later_one(logged: List[str]) -> None:
    lost, both = [], threading.Event()

    def change(found: Any) -> None:
        if found.state is LeaseState.LOST:
            lost.append(found.goal)
            if len(lost) == 2:
                both.set()
            raise ValueError("broken")

    watch = LeaseWatch("drive/lease", change)
    for owner in ("/a", "/b"):
        watch._receive(Lease(owner=owner, life="1", held=[f"goal of {owner}"]))
        watch._receive(Lease(owner=owner, life="1", held=[]))
    assert both.wait(LONG), lost
    watch.shutdown()
    assert "goal of /a" in logged[0] and "ValueError: broken" in logged[0]


def test_the_end_of_a_goal_stays_its_end_when_its_client_fails(logged: List[str]) -> None:
    def fail(_: ClientGoal) -> None:
        raise ValueError("broken")

    goal = ClientGoal(GoalID(id="goal 1"), lambda goal: None, fail, None)
    goal.finish(GoalStatus.LOST, "its server is gone", None)
    assert goal.done and goal.status == GoalStatus.LOST
    assert "goal 1" in logged[0] and "ValueError: broken" in logged[0]


def test_a_watch_without_a_held_goal_waits_for_the_next_lease(
    logged: List[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    callbacks: List[Any] = []
    looks: List[int] = []
    subscriber = SimpleNamespace(unregister=lambda: None)

    def subscribe(_: str, __: Any, callback: Any, **___: Any) -> Any:
        callbacks.append(callback)
        return subscriber

    def peers(_: Any) -> Set[str]:
        looks.append(len(looks))
        return {"/a"}

    monkeypatch.setattr(lease_watch.rospy, "Subscriber", subscribe)
    monkeypatch.setattr(lease_watch, "connected_peers", peers)
    before = set(threading.enumerate())
    watch = LeaseWatch("drive/lease", lambda change: None)
    (receive,) = callbacks
    for life in range(50):
        receive(Lease(owner="/a", life=str(life), held=[]))
    (thread,) = set(threading.enumerate()) - before
    watch.shutdown()
    thread.join(LONG)
    assert not thread.is_alive() and len(looks) == 0

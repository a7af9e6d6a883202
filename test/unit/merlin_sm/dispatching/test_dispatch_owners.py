"""Which nodes own the plan of a dispatcher, by their leases."""

from typing import List

import pytest
from merlin_msgs.msg import Lease

from merlin_ros.actions.lease import LOSE_AFTER
from merlin_sm.dispatching import owners as module
from merlin_sm.dispatching.owners import DispatchOwners


@pytest.fixture
def now(monkeypatch: pytest.MonkeyPatch) -> List[float]:
    time = [100.0]
    monkeypatch.setattr(module, "running_time", lambda: time[0])
    return time


def test_an_owner_lives_as_long_as_it_renews_its_lease(now: List[float]) -> None:
    owners = DispatchOwners("/me")
    owners.heard(Lease(owner="/me", held=["plan"]))
    owners.heard(Lease(owner="/other", held=["plan"]))
    assert owners.living == "/other"
    now[0] += LOSE_AFTER
    assert owners.living == ""


def test_owners_that_died_are_not_kept(now: List[float]) -> None:
    owners = DispatchOwners("/me")
    for number in range(1000):
        owners.heard(Lease(owner=f"/anonymous_{number}", held=["plan"]))
        now[0] += LOSE_AFTER
    assert len(owners._renewed) == 1

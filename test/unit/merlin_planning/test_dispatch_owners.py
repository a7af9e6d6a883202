# SPDX-License-Identifier: Apache-2.0
"""Which nodes own the plan of a dispatcher, by their leases."""

from typing import List

import pytest
from merlin_msgs.msg import Lease

from merlin_planning import dispatcher_kind as module
from merlin_planning.dispatcher_kind import DispatchOwners
from merlin_ros.actions.hang_watch import HangWatch
from merlin_ros.actions.lease import LOSE_AFTER


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
    now[0] += LOSE_AFTER + 0.1
    assert owners.living == ""


def test_a_hang_of_this_process_is_no_silence_of_an_owner(
    now: List[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    watch = HangWatch(lambda: now[0])
    monkeypatch.setattr(module, "hangs", watch)
    watch.beat()
    owners = DispatchOwners("/me")
    owners.heard(Lease(owner="/other", held=["plan"]))
    now[0] += 10.0
    watch.beat()
    assert owners.living == "/other"
    for _ in range(2):  # nothing of it was waiting here
        now[0] += 0.5
        watch.beat()
    assert owners.living == ""


def test_an_owner_that_releases_its_plan_owns_none_and_may_own_the_next(now: List[float]) -> None:
    owners = DispatchOwners("/me")
    for held in (["plan"], [], ["next plan"]):
        owners.heard(Lease(owner="/other", life="one", held=held))
        assert owners.living == ("/other" if held else "")

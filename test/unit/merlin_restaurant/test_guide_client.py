"""Who guides a client sees the client sit down before the robot leaves the table."""

from types import SimpleNamespace
from typing import List

import pytest

from merlin_restaurant.actions import guide_client
from merlin_restaurant.actions.guide_client import SITS_DOWN, GuideClient


@pytest.fixture()
def action(monkeypatch: pytest.MonkeyPatch) -> GuideClient:
    monkeypatch.setattr(guide_client, "people_at", lambda table, seen: len(seen))
    action = GuideClient.__new__(GuideClient)  # without its servers
    action._begin()
    return action


def look(action: GuideClient, monkeypatch: pytest.MonkeyPatch, now: float, seen: List[str]) -> object:
    monkeypatch.setattr(guide_client.rospy, "get_time", lambda: now)
    return action._seated(SimpleNamespace(t="table_1", detections=seen))


def test_the_robot_looks_until_somebody_sits_at_the_table(
    action: GuideClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert look(action, monkeypatch, 100.0, []) == "not_yet"
    assert look(action, monkeypatch, 100.0 + SITS_DOWN - 1.0, []) == "not_yet"
    assert look(action, monkeypatch, 100.0 + SITS_DOWN, ["person"]) is None


def test_a_client_who_does_not_sit_down_is_not_seated(
    action: GuideClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert look(action, monkeypatch, 100.0, []) == "not_yet"
    with pytest.raises(ValueError, match="nobody sits down at table_1"):
        look(action, monkeypatch, 101.0 + SITS_DOWN, [])

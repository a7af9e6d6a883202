# SPDX-License-Identifier: Apache-2.0
"""The players' node: its parameters, its begin and its end."""

import threading
from types import SimpleNamespace
from typing import Any, Callable, Dict, List

import pytest

from merlin_guests import players_node
from merlin_guests.players_node import Players
from merlin_guests.stage import Closed
from merlin_ros.service_proxy import ServiceError
from merlin_test import LONG


@pytest.fixture()
def reported(monkeypatch: pytest.MonkeyPatch) -> Dict[str, Any]:
    """The node's parameters; the evening itself ends at once, with what it would be."""
    parameters: Dict[str, Any] = {"~world": "restaurant"}
    monkeypatch.setattr(players_node, "init_node", lambda name: None)
    monkeypatch.setattr(players_node.rospy, "get_param", lambda name, default: parameters.get(name, default))

    def make(*given: Any) -> SimpleNamespace:
        return SimpleNamespace(run=lambda: parameters.update(given=given) or 0)

    monkeypatch.setattr(players_node, "make_players", make)
    return parameters


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("~wrong_share", "x", "parameter ~wrong_share is 'x', not a number"),
        ("~wrong_share", 25, "parameter ~wrong_share is 25, more than 1"),
        ("~wrong_share", -0.1, "parameter ~wrong_share is -0.1, less than 0"),
        ("~guests", 2.9, "parameter ~guests is 2.9, not a whole number"),
        ("~guests", [2], "parameter ~guests is [2], not a number"),
        ("~guests", 12, "12 guests cannot be"),
        ("~seed", "x", "parameter ~seed is 'x', not a number"),
        ("~haste", {}, "parameter ~haste is {}, not a number"),
        ("~disturbances", True, "parameter ~disturbances is True, not a number"),
        ("~disturbances", 1.5, "parameter ~disturbances is 1.5, not a whole number"),
        ("~disturbances", ["leaves", "fire"], "'fire' cannot be"),
        ("~world", "", "parameter ~world is missing"),
        ("~world", "/nowhere.yaml", "/nowhere.yaml"),
    ],
)
def test_a_parameter_that_cannot_be_is_named(
    reported: Dict[str, Any], capsys: pytest.CaptureFixture, name: str, value: object, text: str
) -> None:
    reported[name] = value
    assert players_node.main() == 2
    assert text in capsys.readouterr().err
    assert "given" not in reported


@pytest.mark.parametrize("disturbances", ("leaves,chair", "leaves chair", ["leaves", "chair"]))
def test_disturbances_can_be_named(reported: Dict[str, Any], disturbances: object) -> None:
    reported.update({"~disturbances": disturbances, "~guests": 3.0, "~wrong_share": 1})
    assert players_node.main() == 0
    _, plans, _, wrong_share, robots = reported["given"]
    assert robots == [""]
    assert sorted(kind for plan in plans for kind in plan.disturbances) == ["chair", "leaves"]
    assert (len(plans), wrong_share) == (3, 1.0)


class Stand:
    """A stage of which only beginning and end are there."""

    def __init__(self) -> None:
        self.missing = ""
        self.listened = True
        self.reported: List[int] = []
        self.removed: List[str] = []
        self.closed = threading.Event()

    def ready(self, timeout: float) -> str:
        return self.missing

    def wait_for_subscriber(self, timeout: float) -> bool:
        return self.listened

    def people(self) -> List[str]:
        return [players_node.BARMAN, "passer-by"]

    def remove(self, name: str) -> None:
        self.removed.append(name)

    def publish(self, event: int, *_: object) -> None:
        self.reported.append(event)

    def close(self) -> None:
        self.closed.set()


class Player:
    """Plays what a test wants."""

    def __init__(self, play: Callable[[], None]) -> None:
        self.play = play
        self.plan = type("Plan", (), {"name": "ann"})


class Log:
    """What is logged, and whether the node is going down."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.lines: Dict[str, List[str]] = {"logwarn": [], "logfatal": []}
        self.down = False
        for level, lines in self.lines.items():
            patch.setattr(players_node.rospy, level, lines.append)
        patch.setattr(players_node.rospy, "on_shutdown", lambda close: None)
        patch.setattr(players_node.rospy, "is_shutdown", lambda: self.down)
        patch.setattr(players_node, "spin", lambda: None)
        patch.setattr(players_node, "is_shutdown_requested", lambda: self.down)


@pytest.fixture()
def log(monkeypatch: pytest.MonkeyPatch) -> Log:
    return Log(monkeypatch)


def evening(stand: Stand, guest: Callable[[], None] = lambda: None) -> Players:
    def serve() -> None:
        assert stand.closed.wait(LONG)
        raise Closed

    return Players(stand, ["bottle"], [Player(guest)], Player(serve))  # type: ignore[arg-type,list-item]


def test_the_evening_closes_when_all_guests_have_left(log: Log) -> None:
    stand = Stand()
    assert evening(stand).run() == 0
    assert stand.reported == [players_node.GuestEvent.CLOSED]
    assert log.lines == {"logwarn": [], "logfatal": []}


def test_the_room_is_cleared_but_for_the_barman(log: Log) -> None:
    stand = Stand()
    assert evening(stand).run() == 0
    assert stand.removed == ["passer-by", "bottle"]


def test_an_evening_without_a_subscriber_begins_with_a_warning(log: Log) -> None:
    stand = Stand()
    stand.listened = False
    assert evening(stand).run() == 0
    assert "restaurant/guests has no subscriber" in log.lines["logwarn"][0]


def test_a_player_that_fails_ends_the_evening_with_the_reason(log: Log) -> None:
    def fail() -> None:
        raise ServiceError("service /merlin_sim/walk does not answer")

    assert evening(Stand(), fail).run() == 1
    assert "ann cannot continue" in log.lines["logfatal"][0]


def test_what_fails_because_the_node_goes_down_is_no_failure(log: Log) -> None:
    stand = Stand()

    def interrupted() -> None:
        log.down = True
        stand.close()
        raise ServiceError("service /merlin_sim/walk does not answer")

    assert evening(stand, interrupted).run() == 0
    assert log.lines["logfatal"] == []


@pytest.mark.parametrize("down", (True, False))
def test_a_stage_that_is_not_there_is_a_failure_only_while_the_node_lives(log: Log, down: bool) -> None:
    stand, log.down = Stand(), down
    stand.missing = "no service /merlin_sim/place after 60 s"
    assert evening(stand).run() == (0 if down else 1)
    assert log.lines["logfatal"] == ([] if down else ["players: no service /merlin_sim/place after 60 s"])

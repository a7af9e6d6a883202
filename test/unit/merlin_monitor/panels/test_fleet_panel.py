# SPDX-License-Identifier: Apache-2.0
"""The panel of the fleet: what it shows of a real hub, and how the page draws it."""

import json
import re
import threading
from typing import Any, Callable, Dict, Iterator, List, Set, Tuple
from xml.etree import ElementTree

import pytest
import rospy
from served import WEB, Served
from shown_page import Visit, chromium, show_panels

from merlin_fleet.core import records
from merlin_fleet.core.records import Claim, Goal, Keys, Profile, Report, Status
from merlin_fleet.core.store import Put, Txn
from merlin_fleet.core.view import FleetGoalState
from merlin_fleet.fleet_request import GoalNews
from merlin_fleet.fleet_shown import MOST, shown
from merlin_fleet.hub import EtcdHub
from merlin_fleet.node import fleet_panel
from merlin_fleet.node.fleet_panel import FleetPanel
from merlin_monitor.listeners.ros_system import RosSystem
from merlin_monitor.panel_board import OFFERED, foreign_panel, own_panels, script_of
from merlin_ros.master.master_link import ERRORS
from merlin_test import LONG
from merlin_test.etcd_process import EtcdProcess

pytestmark = pytest.mark.processes

SHOWN: Dict[str, Any] = {
    "fleet": "lab",
    "robots": {
        "ann": {"joined": True, "heard": 1000.0, "is": ["ward"], "has": ["(checked kitchen)"]},
        "bob": {"joined": False, "heard": 1000.0, "is": [], "has": []},
    },
    "goals": [
        {"id": "g1", "text": "(checked kitchen)", "state": "owned", "robot": "ann", "over": False}
        | {"finish": False, "why": ""},
        {"id": "g2", "text": "(checked hall)", "state": "owned", "robot": "ann", "over": False}
        | {"finish": True, "why": ""},
        {"id": "g3", "text": "(checked moon)", "state": "open", "robot": "", "over": False}
        | {"finish": False, "why": "ann: no plan"},
        {"id": "g4", "text": "(checked bath)", "state": "succeeded", "robot": "bob", "over": True}
        | {"finish": False, "why": ""},
    ],
    "more": 3,
    "missing": "",
    "missing_since": None,
}


def test_every_text_has_its_german_one() -> None:
    scripts = sorted(script_of(FleetPanel).parent.glob("*.js"))
    script = "".join(path.read_text(encoding="utf-8") for path in scripts)
    texts: Set[str] = set(re.findall(r"\bt\(\"([^\"]+)\"", script)) | {FleetPanel.title, "is not reached"}
    texts |= {state.value for state in FleetGoalState if state is not FleetGoalState.ENDED} | {"missed"}
    table = json.loads((WEB / "texts.de.json").read_text(encoding="utf-8"))
    assert sorted(text for text in texts if text not in table) == []
    assert len(texts) > 10


def test_the_launch_file_adds_it_to_the_robots_page() -> None:
    launch = ElementTree.parse(WEB.parents[2] / "launch" / "fleet.launch")
    found = [
        each.get("value") for each in launch.iter("param") if each.get("name", "").startswith(f"{OFFERED}/")
    ]
    (path,) = found
    assert path is not None and foreign_panel(path) is FleetPanel


class Client:
    """What a client knows."""

    fleet = "lab"
    missing = ""
    heard = 0.0

    def __init__(self, goals: List[GoalNews], robots: List[Tuple[Profile, bool]]) -> None:
        self.goals = lambda remarked=None: goals
        self.robots = lambda: robots
        self.status = lambda robot: (Status(), None)
        self.spoke = lambda robot: 7.0


def test_goals_that_go_on_come_first_and_the_last_ends_then() -> None:
    def news(name: str, state: FleetGoalState, owner: str = "", ended: float = 0.0) -> GoalNews:
        report = Report(name, "bob", 1, "SUCCEEDED", "", ended) if ended else None
        return GoalNews(Goal(name, (f"(done {name})",), 0.0), state, owner, {"ann": "no plan"}, report)

    over = [news(f"e{number}", FleetGoalState.ENDED, "", number + 1.0) for number in range(MOST)]
    found = shown(
        Client(  # type: ignore[arg-type]
            [*over, news("a", FleetGoalState.OPEN), news("b", FleetGoalState.OWNED, "ann")],
            [(Profile("ann", ("ward",), ("arm",), heard=5.0), True), (Profile("bob", heard=4.0), False)],
        )
    )
    assert [goal["id"] for goal in found["goals"]] == ["a", "b", *(f"e{n}" for n in range(MOST - 1, 1, -1))]
    assert found["more"] == 2
    assert found["goals"][0]["why"] == "ann: no plan"
    ann, bob = (found["robots"][name] for name in ("ann", "bob"))
    assert (ann["joined"], ann["heard"], ann["is"], ann["has"]) == (True, 5.0, ["ward", "arm"], ["(done b)"])
    assert ann["spoke"] == 7.0
    assert (bob["joined"], bob["heard"], bob["is"], bob["has"]) == (False, 4.0, [], [])


class Master:
    """The parameters of the robot's part in the fleet."""

    def __init__(self, parameters: Any) -> None:
        self._parameters = parameters

    def getParam(self, name: str) -> Any:
        assert name == "/merlin_fleet"
        if self._parameters is None:
            raise ERRORS[0]("there is no such parameter")
        return self._parameters


@pytest.fixture
def closed(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    ends: List[Callable[[], None]] = []
    monkeypatch.setattr(rospy, "on_shutdown", ends.append)
    monkeypatch.setattr(rospy, "resolve_name", lambda name: f"/{name}")
    yield
    for end in ends:
        end()


@pytest.mark.usefixtures("closed")
def test_it_follows_the_hub_that_the_robot_was_told(served: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    def master(parameters: Any) -> None:
        monkeypatch.setattr(fleet_panel, "bounded_master", lambda: Master(parameters))

    panel = FleetPanel(served.state, RosSystem())
    tree = served.state.tree

    def until(holds: Callable[[], bool]) -> None:
        panel.check(0.0, 0.0)
        while not holds():
            assert panel._changed.wait(LONG)
            panel.check(0.0, 0.0)

    master(None)
    panel.look({})
    panel.check(0.0, 0.0)
    assert tree.get("fleet", "robots") is None
    etcd = EtcdProcess()
    try:
        keys = Keys("lab")
        hub = EtcdHub(keys.root, [etcd.endpoint], timeout=20.0)
        puts = {
            keys.key(records.GOALS, "g1"): Goal("g1", ("(done)",), 1.0, finish=True),
            keys.key(records.CLAIMS, "ann", "g1"): Claim("ann", "x"),
            keys.key(records.LIVES, "ann"): Claim("ann", "x"),
            keys.key(records.ROBOTS, "ann"): Profile("ann", heard=5.0),
        }
        hub.transact(Txn((), tuple(Put(key, records.encode(record)) for key, record in puts.items())))
        hub.close()
        master({"fleet": "lab", "hub": etcd.endpoint, "ca": "", "robot": "ann"})
        panel.look({})
        until(lambda: bool(tree.get("fleet", "goals")))
        (goal,) = tree.get("fleet", "goals")
        assert (goal["robot"], goal["finish"], tree.get("fleet", "missing")) == ("ann", True, "")
        etcd.kill()
        until(lambda: bool(tree.get("fleet", "missing")))
        assert tree.get("fleet", "missing_since") > 0
        etcd.start()
        until(lambda: not tree.get("fleet", "missing"))
        assert tree.get("fleet", "missing_since") is None
    finally:
        etcd.close()


@pytest.mark.usefixtures("closed")
def test_it_follows_another_hub_when_the_robots_part_begins_with_that(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    follows: List[str] = []

    class Follower:
        def __init__(self, fleet: str, endpoints: Tuple[str, ...], *_: Any) -> None:
            self._name = f"{fleet} at {','.join(endpoints)}"
            follows.append(self._name)

        def close(self) -> None:
            follows.remove(self._name)

    monkeypatch.setattr(fleet_panel, "FleetClient", Follower)
    panel = FleetPanel(served.state, RosSystem())

    def look(parameters: Any) -> List[str]:
        monkeypatch.setattr(fleet_panel, "bounded_master", lambda: Master(parameters))
        panel.look({})
        return list(follows)

    lab = {"fleet": "lab", "hub": "a:2379"}
    assert look(lab) == ["lab at a:2379"]
    first = follows[0]
    assert look(dict(lab))[0] is first, "it goes on"
    assert look(None)[0] is first, "the last known hub stays"
    assert look({**lab, "hub": "b:2379"}) == ["lab at b:2379"]
    assert look({"fleet": "ward", "hub": "b:2379"}) == ["ward at b:2379"]


@pytest.mark.usefixtures("closed")
@pytest.mark.parametrize("hub", [2379, [2379], "hub"])
def test_a_hub_that_is_not_one_is_named(served: Served, monkeypatch: pytest.MonkeyPatch, hub: Any) -> None:
    monkeypatch.setattr(fleet_panel, "bounded_master", lambda: Master({"fleet": "lab", "hub": hub}))
    FleetPanel(served.state, RosSystem()).look({})
    taken = threading.Event()
    served.state.inbox.put(taken.set)
    assert taken.wait(LONG)
    assert "is not the address of a hub" in served.state.tree.get("fleet", "missing")


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as found:
        yield found


@pytest.mark.parametrize(
    ("language", "heard", "lease", "link"),
    [
        ("en", "not seen since", "ann, on its lease", "Without the hub since"),
        ("de", "nichts gehört seit", "ann, auf Zeit vergeben", "Ohne den Hub seit"),
    ],
)
def test_the_page_shows_it(
    browser: Any, served: Served, language: str, heard: str, lease: str, link: str
) -> None:
    show_panels(served)
    served.scripts["fleet"] = script_of(FleetPanel)
    panels = [panel.described() for panel in (*own_panels(), FleetPanel)]
    served.state.tree.set("meta", "panels", panels)
    for part, value in SHOWN.items():
        served.state.tree.set("fleet", part, value)
    page = Visit(browser, f"{served.url}?lang={language}")
    page.wait("() => document.querySelectorAll('#fleet-goals li').length === 4")
    ann, bob = page.texts("#fleet-robots li")
    assert "ann" in ann and "ward" in ann and "(checked kitchen)" in ann and heard not in ann
    assert "bob" in bob and heard in bob
    goals = page.texts("#fleet-goals li")
    assert lease in goals[0] and lease not in goals[1] and "Hub" in goals[1] or "hub" in goals[1]
    assert "ann: no plan" in goals[2]
    served.state.tree.set("fleet", "missing_since", 1000.0)
    served.state.tree.set("fleet", "missing", "etcd is gone")
    page.wait(
        f"() => [...document.querySelectorAll('p')].some((each) => each.innerText.startsWith({link!r}))"
    )
    assert page.complaints == []
    page.close()


def test_a_robot_is_grey_when_its_last_word_is_old_by_the_clock_of_the_page(
    browser: Any, served: Served
) -> None:
    show_panels(served)
    served.scripts["fleet"] = script_of(FleetPanel)
    served.state.tree.set("meta", "panels", [panel.described() for panel in (*own_panels(), FleetPanel)])
    now = 1e6
    served.state.tree.put("meta", time=now, simulated=False)
    times = {"behind": (now - 120.0, now - 1.0), "ahead": (now + 60.0, now - 240.0)}
    robots = {
        name: {"joined": True, "heard": heard, "spoke": spoke, "is": [], "has": []}
        for name, (heard, spoke) in times.items()
    }
    served.state.tree.set("fleet", "robots", robots)
    page = Visit(browser, f"{served.url}?lang=en")
    page.wait("() => document.querySelectorAll('#fleet-robots li').length === 2")
    behind, ahead = page.texts("#fleet-robots li")
    assert "joined" in behind and "1.0 s ago" in behind
    assert "not seen since" in ahead and "ago" in ahead
    assert page.complaints == []
    page.close()

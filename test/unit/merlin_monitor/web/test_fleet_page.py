# SPDX-License-Identifier: Apache-2.0
"""The page of a fleet: what it shows, which operator may do what, and how the browser shows a lost hub."""

import re
import threading
import time
from pathlib import Path
from typing import Any, Callable, Iterator, List, Optional

import pytest
from fakes.simulated_store import SimulatedStore
from fleet_page_command import Command
from served import TOKEN, ask
from shown_page import Visit, chromium

from merlin_fleet import fleet_client
from merlin_fleet.certified import HubError
from merlin_fleet.core import records
from merlin_fleet.core.records import Claim, Goal, Keys, Profile, Report, Schema, Status
from merlin_fleet.core.store import Put, Txn, TxnResult
from merlin_fleet.fleet_client import FleetClient
from merlin_fleet.fleet_shown import shown
from merlin_fleet.hub import EtcdHub
from merlin_fleet.hub_watch import Listener
from merlin_fleet.page import fleet_page
from merlin_fleet.page.fleet_control import FleetControl
from merlin_fleet.page.fleet_page import PANELS, FleetPage
from merlin_monitor.access.operators import Operators, write_operators
from merlin_monitor.access.web_access import WebAccess
from merlin_monitor.panel_scripts import script_file
from merlin_monitor.text.phrase import in_english
from merlin_monitor.web.page_control import ControlError
from merlin_monitor.web.web_server import WebServer
from merlin_test import LONG
from merlin_test.etcd_process import EtcdProcess

pytestmark = pytest.mark.processes
KEYS, EVIL = Keys("lab"), "<img src=x onerror=\"document.title='owned'\">"

SCHEMA = Schema("(define (domain lab) (:predicates (done ?x)))", ("a object", "b object"))
DRIVES = Status(
    *(("navigate from=hall to=kitchen",), ("(checked kitchen)",), "DISPATCH_PLAN"),
    *("", "hall", 1.0, 2.5),
    page="http://bob.lab:8080/",
    at=4e9,
)


class SimulatedHub:
    """A simulated store as a client's hub; its changes arrive at once."""

    def __init__(self) -> None:
        self.store = SimulatedStore()
        self.lost = ""
        self.obeys: Optional[str] = None
        """How robots say that they are held, when they were stopped; None: they do not answer."""
        self._listener = Listener()

    def follow(self, listener: Listener) -> None:
        self._listener = listener
        listener.on_connected(self.store.snapshot())

    def time(self) -> float:
        return time.time()

    def transact(self, txn: Txn) -> TxnResult:
        self.check()
        known = len(self.store.changes)
        answer = self.store.transact(txn)
        self._listener.on_changed(tuple(self.store.changes[known:]))
        kind, *names = KEYS.parts(txn.puts[0].key) if txn.puts else ("",)
        if kind == records.HALTS and self.obeys is not None:
            self.put(records.STATUS, *names, record=Status(hold=self.obeys, stop=answer.revision, at=6.0))
            self.transact(Txn(deletes=(txn.puts[0].key,)))
        return answer

    def put(self, kind: str, *names: str, record: Any) -> None:
        """Writes a record."""
        self.transact(Txn(puts=(Put(KEYS.key(kind, *names), records.encode(record)),)))

    def check(self) -> None:
        if self.lost:
            raise HubError(self.lost)

    def lose(self, reason: str) -> None:
        """The hub is lost."""
        self.lost = reason
        self._listener.on_disconnected(reason)

    def close(self) -> None:
        pass


class Lab:
    """A page and its server over a simulated hub."""

    def __init__(self, folder: Path, open_stop: bool) -> None:
        self.hub = SimulatedHub()
        self.client = FleetClient("lab")
        path = folder / "operators.yaml"
        write_operators(path, {"Ana": TOKEN})
        operators = Operators(path)
        self.page = FleetPage(self.client, operators)
        self.control = FleetControl(self.client)
        access = WebAccess("127.0.0.1", (), operators, open_stop)
        scripts = {panel["name"]: script_file(panel["script"]) for panel in PANELS}
        self.server = WebServer(self.page, access, self.control, scripts=scripts)

    def start(self) -> None:
        """Begins to serve."""
        self.page.start()
        self.server.start()

    def until(self, holds: Callable[[Any], bool], *path: str) -> Any:
        """Waits until something holds of what is shown at a path."""
        changed = threading.Event()
        feed = self.page.tree.subscribe(changed.set)
        try:
            while not holds(self.page.tree.get(*path)):
                assert changed.wait(LONG), f"it never holds: {self.page.tree.get(*path)}"
                changed.clear()
                feed.take()
        finally:
            feed.close()
        return self.page.tree.get(*path)

    def stop(self) -> None:
        """Ends all."""
        self.server.stop()
        self.page.stop()
        self.client.close()


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Iterator[Lab]:
    hubs: List[SimulatedHub] = []

    def hub(*_: Any, **__: Any) -> SimulatedHub:
        hubs.append(SimulatedHub())
        return hubs[-1]

    monkeypatch.setattr(fleet_client, "EtcdHub", hub)
    made = Lab(tmp_path, getattr(request, "param", True))
    made.hub = hubs[0]
    yield made
    made.stop()


def fill(hub: SimulatedHub) -> None:
    """Two robots, of which one is joined, and three goals."""
    hub.put(records.ROBOTS, "ann", record=Profile("ann", ("ward",), heard=5.0))
    hub.put(records.LIVES, "ann", record=Claim("ann", "x"))
    hub.put(records.ROBOTS, "bob", record=Profile("bob", heard=4.0))
    for name in ("g1", "g2", "g3"):
        hub.put(records.GOALS, name, record=Goal(name, (f"(done {name})",), 1.0))
    hub.put(records.CLAIMS, "ann", "g1", record=Claim("ann", "x"))
    hub.put(records.ENDS, "ann", "g3", record=Report("g3", "ann", 3, "SUCCEEDED", EVIL, 2.0))


def test_a_record_that_cannot_be_shown_does_not_end_the_page(
    lab: Lab, monkeypatch: pytest.MonkeyPatch
) -> None:
    fill(lab.hub)
    lab.start()
    lab.hub.put(records.STATUS, "ann", record=DRIVES._replace(goals=("((done a) b)",)))
    lab.until(lambda robot: robot["for"] != [], "fleet", "robots", "ann")
    raised = threading.Event()

    def strange(*_: Any) -> Any:
        raised.set()
        raise ValueError("a strange record")

    with monkeypatch.context() as patch:
        patch.setattr(fleet_page, "shown", strange)
        lab.hub.put(records.STATUS, "ann", record=DRIVES)
        assert raised.wait(LONG)
    lab.hub.put(records.STATUS, "ann", record=DRIVES._replace(place="ward"))
    lab.until(lambda robot: robot["place"] == "ward", "fleet", "robots", "ann")


def test_it_shows_robots_goals_and_owners_and_follows_them(lab: Lab) -> None:
    fill(lab.hub)
    lab.start()
    assert lab.until(bool, "fleet", "counts") == {"joined": 1, "robots": 2, "owned": 1, "open": 1}
    robots = lab.page.tree.get("fleet", "robots")
    assert {name: (robot["joined"], robot["heard"]) for name, robot in robots.items()} == {
        "ann": (True, 5.0),
        "bob": (False, 4.0),
    }
    assert robots["ann"]["has"] == ["(done g1)"]
    goals = {goal["id"]: goal for goal in lab.page.tree.get("fleet", "goals")}
    assert {name: (goal["state"], goal["robot"]) for name, goal in goals.items()} == {
        "g1": ("owned", "ann"),
        "g2": ("open", ""),
        "g3": ("succeeded", "ann"),
    }
    lab.hub.transact(Txn(deletes=(KEYS.key(records.LIVES, "ann"), KEYS.key(records.CLAIMS, "ann", "g1"))))
    lab.until(lambda counts: counts == {"joined": 0, "robots": 2, "owned": 0, "open": 2}, "fleet", "counts")
    assert {goal["why"] for goal in lab.page.tree.get("fleet", "goals") if not goal["over"]} == {
        "no robot is joined"
    }


def test_it_shows_what_a_robot_says_of_itself(lab: Lab) -> None:
    fill(lab.hub)
    doing, goals = ("navigate from=hall to=dorm_room",), ("(checked dorm_room)",)
    said = Status(
        doing, goals, "DISPATCH_PLAN", "", "dorm_room", 1.0, 2.0, page="http://ann.lab:8080/", at=9.0
    )
    lab.hub.put(records.STATUS, "ann", record=said)
    lab.start()
    ann, bob = (lab.until(bool, "fleet", "robots")[name] for name in ("ann", "bob"))
    assert ([in_english(each) for each in ann["does"]], in_english(ann["for"])) == (
        ["navigating to dorm room"],
        "dorm room checked",
    )
    assert (ann["place"], ann["at"], ann["page"], ann["heard"]) == (
        "dorm room",
        [1.0, 2.0],
        "http://ann.lab:8080/",
        9.0,
    )
    assert (bob["does"], bob["at"], bob["page"], bob["heard"]) == ("", None, "", 4.0), "it has said nothing"
    for stage, words in (("PLAN", "planning"), ("", "waits")):
        lab.hub.put(records.STATUS, "ann", record=Status(stage=stage, at=10.0))
        robots = lab.until(
            lambda robots: not robots["ann"]["for"] and robots["ann"]["does"], "fleet", "robots"
        )
        lab.until(lambda it, said=words: in_english(it["ann"]["does"]) == said, "fleet", "robots")
        assert robots["ann"]["place"] == ""


def test_what_a_robot_does_is_as_old_as_its_last_word_of_it(lab: Lab) -> None:
    fill(lab.hub)
    lab.hub.put(records.STATUS, "ann", record=Status(stage="PLAN", at=3.0))  # joined since then: heard at 5.0
    assert shown(lab.client)["robots"]["ann"]["heard"] == 3.0


@pytest.mark.parametrize(
    "page", ["javascript:alert(1)", "http://ann.lab@evil.example/", "https://", "//evil"]
)
def test_a_link_leads_to_a_page(lab: Lab, page: str) -> None:
    fill(lab.hub)
    lab.hub.put(records.STATUS, "ann", record=Status(page=page, at=9.0))
    assert shown(lab.client)["robots"]["ann"]["page"] == ""


def test_a_goal_that_no_robot_knows_is_refused_at_once(lab: Lab) -> None:
    fill(lab.hub)
    known = len(lab.client.goals())
    for robot in ("ann", "bob"):
        lab.hub.put(records.SCHEMAS, robot, record=SCHEMA)
    for fields, words in (
        ({"goal": "(flies a)"}, "ann, bob: (flies a): unknown predicate 'flies'; there is done"),
        ({"goal": "(done a)", "robot": "eve"}, "there is no robot 'eve' in the fleet; there is ann, bob"),
    ):
        with pytest.raises(ControlError, match=re.escape(words)):
            lab.control.carry_out("send", fields, "Ana")
    assert len(lab.client.goals()) == known
    said = lab.control.carry_out("send", {"goal": "(done a)", "needs": "wings"}, "Ana")["done"]
    assert said.endswith(
        "But no robot can take it, and it waits for one; the robots of this fleet: ann, bob."
    )
    assert lab.control.carry_out("send", {"goal": "(done a)"}, "Ana")["done"].startswith("Sent as ")


def test_a_stop_is_confirmed_by_the_robot(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    fill(lab.hub)
    lab.hub.obeys = "the base is held by Ana since 14:03:07"
    said = lab.control.carry_out("stop", {"robot": "ann"}, "Ana")
    assert said == {"done": "ann stands: the base is held by Ana since 14:03:07."}
    assert lab.client.status("ann")[1] is None
    lab.hub.obeys = ""
    with pytest.raises(ControlError, match="ann: the stop is NOT confirmed: its guard has not confirmed it"):
        lab.control.carry_out("stop", {"robot": "ann"}, "Ana")
    lab.hub.obeys = None
    monkeypatch.setattr(fleet_client, "STOPS", 0.01)
    for robot, words in (("ann", "it has not answered yet"), ("bob", "it is not joined, and stops when")):
        with pytest.raises(ControlError, match=f"{robot}: the stop is NOT confirmed: {words}"):
            lab.control.carry_out("stop", {"robot": robot}, "Ana")
        assert lab.client.status(robot)[1] is not None, "it stops when it hears of it"
        assert shown(lab.client)["robots"][robot]["stop"] > 0.0
    with pytest.raises(ControlError, match=r"there is no such robot in the fleet\. Use the button"):
        lab.control.carry_out("stop", {"robot": "eve"}, "Ana")
    lab.hub.lose("etcd does not answer in time")
    with pytest.raises(ControlError, match=r"NOT confirmed: the hub has not .*\. Use the button"):
        lab.control.carry_out("stop", {"robot": "ann"}, "Ana")


@pytest.mark.parametrize(("lab", "status"), [(True, 200), (False, 403)], indirect=["lab"])
def test_everybody_stops_a_robot_unless_it_is_for_operators(lab: Lab, status: int) -> None:
    fill(lab.hub)
    lab.hub.obeys = "the base is held"
    lab.start()
    answer = ask(lab.server.address, "control/stop", "POST", {}, {"robot": "ann"})
    assert answer.status == status, answer.said
    stopped = [change for change in lab.hub.store.changes if "/halts/" in change.key and change.value]
    assert ["a visitor at 127.0.0.1" in str(each.value) for each in stopped] == [True] * (status == 200)


def test_what_is_shown_without_the_hub_is_grey_since_it_was_heard_of(lab: Lab) -> None:
    fill(lab.hub)
    lab.start()
    lab.until(bool, "fleet", "goals")
    heard = lab.client.heard
    lab.hub.lose("etcd cannot be reached (a cable)")
    silent = lab.until(bool, "fleet", "silent")  # the last part that is shown
    assert silent["since"] >= heard > 0
    assert lab.page.tree.get("fleet", "missing") == "etcd cannot be reached (a cable)"
    assert lab.page.tree.get("fleet", "missing_since") == silent["since"]
    assert len(lab.page.tree.get("fleet", "goals")) == 3, "it is still there to be read"
    lab.hub.lost = ""
    lab.client.on_resumed()
    lab.until(lambda silent: silent is None, "fleet", "silent")
    assert lab.page.tree.get("fleet", "missing") == ""


def test_only_for_listed_goals_it_is_looked_why_they_are_open(
    lab: Lab, monkeypatch: pytest.MonkeyPatch
) -> None:
    looked: List[str] = []
    monkeypatch.setattr(fleet_client, "remarks", lambda view, goal: looked.append(goal.id) or {"ann": "why"})
    fill(lab.hub)
    for number in range(100):
        name = f"open{number:03}"
        lab.hub.put(records.GOALS, name, record=Goal(name, ("(done)",), float(number)))
    found = shown(lab.client, 20)
    assert looked == ["open000", "g2", *(f"open{number:03}" for number in range(1, 19))]
    assert found["counts"] == {"joined": 1, "robots": 2, "owned": 1, "open": 101}
    assert all(goal["why"] == "ann: why" for goal in found["goals"] if goal["state"] == "open")
    assert len(found["goals"]) == 20


def test_operators_send_and_cancel(lab: Lab) -> None:
    lab.start()
    fields = {"goal": " (done a) ", "groups": "ward, night", "needs": "long arm,"}
    fields.update(value=2, begin_by=60.0)
    answer = ask(
        lab.server.address,
        "control/send",
        "POST",
        {"X-Merlin-Token": TOKEN},
        fields,
    )
    assert answer.status == 200, answer.said
    (news,) = lab.client.goals()
    goal = news.goal
    assert (goal.goals, goal.groups, goal.needs, goal.value) == (
        ("(done a)",),
        ("ward", "night"),
        ("long arm",),
        2.0,
    )
    assert goal.deadline == pytest.approx(goal.sent + 60.0)
    assert goal.sender.startswith("Ana (")
    assert not goal.finish
    assert lab.control.carry_out("cancel", {"request": goal.id}, "Ana") == {"done": "The cancel was sent."}
    assert '"by": "Ana (' in lab.hub.store.value(KEYS.key(records.CANCELS, goal.id))
    with pytest.raises(ControlError, match="has ended already"):
        lab.control.carry_out("cancel", {"request": goal.id}, "Ana")


def test_nothing_is_done_for_others(lab: Lab) -> None:
    lab.start()
    body, url = {"goal": "(done a)"}, lab.server.address
    right = {"X-Merlin-Token": TOKEN}
    assert ask(url, "control/send", "POST", {}, body).status == 403
    assert ask(url, "control/send", "POST", {"X-Merlin-Token": "guessed guessed"}, body).status == 403
    assert ask(url, "control/send", "POST", {**right, "Origin": "http://evil.example"}, body).status == 403
    assert ask(url, "control/send", "POST", {**right, "Host": "evil.example"}, body).status == 403
    assert ask(url, "state.json", headers={"Host": "evil.example"}).status == 403
    assert lab.client.goals() == []


@pytest.mark.parametrize(
    ("what", "fields", "words"),
    [
        ("send", {}, "Write a goal"),
        ("send", {"goal": "(done a"}, "goal:1:1: "),
        ("send", {"goal": 7}, "goal is a text"),
        ("send", {"goal": "(done a)", "begin_by": -1}, "must lie in the future"),
        ("send", {"goal": "(done a)", "value": "high"}, "value is a number"),
        ("send", {"goal": "(done a)", "value": 10**400}, "value is a number"),
        ("send", {"goal": "(done a)", "deadline": 60.0}, "deadline is called begin_by"),
        ("send", {"goal": "(done a)", "begin_by": 10**400}, "begin_by is a number"),
        ("send", {"goal": "(done a)", "robot": "a/b"}, "is not a word of letters"),
        ("send", {"goal": "(done a)", "needs": "a" * 201}, "at most 200 characters"),
        ("cancel", {"request": "nothing"}, "there is no goal 'nothing'"),
        ("stop", {"robot": 7}, "robot is a text"),
        ("release", {}, "There is nothing called 'release'"),
    ],
)
def test_what_makes_no_sense_is_refused(lab: Lab, what: str, fields: Any, words: str) -> None:
    with pytest.raises(ControlError, match=re.escape(words)):
        lab.control.carry_out(what, fields, "Ana")
    assert lab.client.goals() == []


def test_a_goal_without_the_hub_is_refused_with_the_reason(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fleet_client, "LIMIT", 0.1)
    lab.hub.lose("etcd does not answer in time")
    with pytest.raises(ControlError, match=r"did not take it .*: etcd does not answer in time"):
        lab.control.carry_out("send", {"goal": "(done a)"}, "Ana")


# --- in the browser ---------------------------------------------------------------------------------


def text_is(page: Visit, selector: str, wanted: str) -> None:
    page.wait_text(selector, wanted, LONG)


def test_the_page_in_a_browser(tmp_path: Path) -> None:
    """Hostile texts, a goal sent and cancelled with a token, and a hub that is killed and comes back."""
    own = EtcdProcess()
    operators = tmp_path / "operators.yaml"
    write_operators(operators, {"Ana": "long enough for a token"})
    command = None
    hub = EtcdHub(KEYS.root, [own.endpoint], timeout=20.0)  # a busy machine has a slow hub
    try:
        puts = {
            KEYS.key(records.ROBOTS, "ann"): Profile("ann", (EVIL,), heard=5.0),
            KEYS.key(records.ROBOTS, "bob"): Profile("bob", heard=DRIVES.at),
            KEYS.key(records.LIVES, "bob"): Claim("bob", "x"),
            KEYS.key(records.SCHEMAS, "bob"): SCHEMA,
            KEYS.key(records.STATUS, "bob"): DRIVES,
            KEYS.key(records.GOALS, "g1"): Goal("g1", (f"(done {EVIL})",), 1.0),
            KEYS.key(records.ENDS, "ann", "g1"): Report("g1", "ann", 3, "FAILED", EVIL, 2.0),
        }
        hub.transact(Txn((), tuple(Put(key, records.encode(record)) for key, record in puts.items())))
        command = Command(own.endpoint, "--operators", str(operators), "--port", "0")
        with chromium() as browser:
            page = Visit(browser, f"{command.address}?lang=en")
            text_is(page, "#now-line", "1 of 2 robots joined")
            text_is(page, "#now-trouble", "ann: not seen since")
            ann, bob = (page.page.locator("#fleet-robots li", has_text=name) for name in ("ann", "bob"))
            says = Put(KEYS.key(records.STATUS, "bob"), records.encode(DRIVES._replace(at=DRIVES.at + 1.0)))
            hub.transact(Txn(puts=(says,)))
            page.wait("() => document.querySelectorAll('#fleet-robots li.stale').length === 1")
            assert "stale" in (ann.get_attribute("class") or "")
            assert "What it does is not known" in ann.inner_text()
            assert "navigating to kitchen, for kitchen checked – at hall (1, 2.5) m" in bob.inner_text()
            assert bob.locator(".page").get_attribute("href") == DRIVES.page
            assert not ann.locator(".page").is_visible()
            bob.locator(".stop").click()  # without a token
            text_is(page, "#control-said", "bob: the stop is NOT confirmed: it has not answered yet")
            text_is(page, "#fleet-robots .stopping", "NOT confirmed")
            stands = DRIVES._replace(hold="the base is held by Ana", stop=2**31)
            key, halts = (KEYS.key(kind, "bob") for kind in (records.STATUS, records.HALTS))
            hub.transact(Txn((), (Put(key, records.encode(stands)),), (halts,)))
            text_is(page, "#fleet-robots .does", "the base is held by Ana")
            bob.locator(".stopping").wait_for(state="hidden")
            bob.locator(".stop").click()
            text_is(page, "#control-said", "bob stands: the base is held by Ana")
            text_is(page, "#fleet-goals .more", EVIL)
            assert not page.page.locator("main img").count() and "owned" not in page.page.title()
            page.page.click("#operator")
            page.page.fill("#token", "long enough for a token")
            page.page.click("#sign-in button[type=submit]")
            text_is(page, "#operator", "Ana")
            assert not page.page.is_visible("#stop")
            page.page.fill("#goal", "(flies b)")
            page.page.fill("#for-robot", "bob")
            page.page.click("#goal-form button[type=submit]")
            text_is(page, "#control-said", "bob: (flies b): unknown predicate 'flies'; there is done")
            page.page.fill("#goal", "(done b)")
            page.page.fill("#for-robot", "ann")
            page.page.click("#goal-form button[type=submit]")
            text_is(page, "#fleet-goals .title", "(done b)")
            row = page.page.locator("#fleet-goals li", has_text="(done b)")
            row.locator(".cancel").click()
            text_is(page, "#fleet-goals .chip", "cancelled")
            own.kill()
            text_is(page, "#now-line", "The hub is not reached since")
            text_is(page, "#now-trouble", "etcd cannot be reached")
            page.wait("() => document.getElementById('fleet').hasAttribute('data-silent')")
            text_is(page, "#fleet .silent", "no news since")
            own.start()
            text_is(page, "#now-line", "1 of 2 robots joined")
            page.wait("() => !document.getElementById('fleet').hasAttribute('data-silent')")
            assert page.complaints == []
            page.close()
        assert command.end()[0] == 0
    finally:
        if command is not None and command.process.poll() is None:
            command.process.kill()
        hub.close()
        own.close()

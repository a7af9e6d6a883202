# SPDX-License-Identifier: Apache-2.0
"""The page of a fleet: what it shows, which operator may do what, and how the browser shows a lost hub."""

import re
import socket
import threading
import time
import urllib.request
from pathlib import Path
from typing import Any, Callable, Iterator, List, Tuple

import pytest
from fleet_page_command import LIMIT, Command
from served import TOKEN, WEB, ask
from shown_page import Visit, chromium

from merlin_fleet import fleet_client
from merlin_fleet.certified import HubError
from merlin_fleet.commands.fleet_command import main
from merlin_fleet.core import records
from merlin_fleet.core.records import Claim, Goal, Keys, Profile, Report
from merlin_fleet.core.store import Put, Txn, TxnResult
from merlin_fleet.fleet_client import FleetClient
from merlin_fleet.fleet_shown import shown
from merlin_fleet.hub import EtcdHub
from merlin_fleet.hub_watch import Listener
from merlin_fleet.page.fleet_control import FleetControl
from merlin_fleet.page.fleet_page import PANELS, FleetPage
from merlin_fleet.testing.simulated_store import SimulatedStore
from merlin_monitor.access.operators import Operators, write_operators
from merlin_monitor.access.web_access import WebAccess
from merlin_monitor.panel_scripts import script_file
from merlin_monitor.web.page_control import ControlError
from merlin_monitor.web.web_server import WebServer
from merlin_test.etcd_process import DIRECT, EtcdProcess

pytestmark = pytest.mark.processes
KEYS, EVIL = Keys("lab"), "<img src=x onerror=\"document.title='owned'\">"


class SimulatedHub:
    """A simulated store as a client's hub; its changes arrive at once."""

    def __init__(self) -> None:
        self.store = SimulatedStore()
        self.lost = ""
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

    def __init__(self, folder: Path) -> None:
        self.hub = SimulatedHub()
        self.client = FleetClient("lab")
        path = folder / "operators.yaml"
        write_operators(path, {"Ana": TOKEN})
        operators = Operators(path)
        self.page = FleetPage(self.client, operators)
        self.control = FleetControl(self.client)
        access = WebAccess("127.0.0.1", (), operators)
        scripts = {panel["name"]: script_file(panel["script"]) for panel in PANELS}
        self.server = WebServer(self.page, WEB, access, self.control, scripts=scripts)

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
                assert changed.wait(LIMIT), f"it never holds: {self.page.tree.get(*path)}"
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
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Lab]:
    hubs: List[SimulatedHub] = []

    def hub(*_: Any, **__: Any) -> SimulatedHub:
        hubs.append(SimulatedHub())
        return hubs[-1]

    monkeypatch.setattr(fleet_client, "EtcdHub", hub)
    made = Lab(tmp_path)
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
    fields = {"goal": " (done a) ", "groups": "ward, night", "needs": "arm", "value": 2, "deadline": 60.0}
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
        ("arm",),
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
        ("send", {"goal": "(done a)", "deadline": -1}, "must lie in the future"),
        ("send", {"goal": "(done a)", "value": "high"}, "value is a number"),
        ("send", {"goal": "(done a)", "value": 10**400}, "value is a number"),
        ("send", {"goal": "(done a)", "deadline": 10**400}, "deadline is a number"),
        ("send", {"goal": "(done a)", "robot": "a/b"}, "is not a word of letters"),
        ("send", {"goal": "(done a)", "needs": "a" * 201}, "at most 200 characters"),
        ("cancel", {"request": "nothing"}, "there is no goal 'nothing'"),
        ("stop", {}, "There is nothing called 'stop'"),
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


# --- the command ------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def etcd() -> Iterator[EtcdProcess]:
    made = EtcdProcess()
    yield made
    made.close()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--port", "port"), "port is not a port: 0 to 65535"),
        (("--port", "70000"), "70000 is not a port: 0 to 65535"),
        (("--host", "203.0.113.1"), "cannot listen on 203.0.113.1"),
        (("--page-key", "/nowhere.key"), "a key is given, but no certificate"),
        (("--page-key", "/nowhere.key", "--page-certificate", "/nowhere.pem"), "/nowhere.pem cannot be read"),
    ],
)
def test_mistakes_are_one_clear_line(
    etcd: EtcdProcess, capsys: pytest.CaptureFixture, arguments: Tuple[str, ...], words: str
) -> None:
    try:
        code: Any = main(["page", "--hub", etcd.endpoint, "--operators", "none", *arguments])
    except SystemExit as end:  # argparse's own
        code = end.code
    assert code == 2
    said = capsys.readouterr()
    assert words in said.err.splitlines()[-1]
    assert not said.out


def test_operators_whom_all_can_read_are_refused(
    etcd: EtcdProcess, capsys: pytest.CaptureFixture, tmp_path: Path
) -> None:
    file = tmp_path / "operators.yaml"
    file.write_text("ana: 'a text that is long'\n")
    file.chmod(0o644)
    assert main(["page", "--hub", etcd.endpoint, "--operators", str(file)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("fleet page: the operators' file") and "chmod 600" in line


def test_it_serves_without_a_master_until_ctrl_c(etcd: EtcdProcess) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        command = Command(etcd.endpoint, "--operators", "none", "--port", str(port))
        assert command.address.startswith("http://127.0.0.1:")
        with DIRECT.open(command.address + "state.json", timeout=LIMIT) as answer:
            assert b'"fleet":"lab"' in answer.read()
        request = urllib.request.Request(command.address + "control/send", b"{}", method="POST")
        with pytest.raises(urllib.error.HTTPError, match="403"):
            DIRECT.open(request, timeout=LIMIT)
        code, said = command.end()
    assert code == 0
    assert f"port {port} is taken, using " in said


# --- in the browser ---------------------------------------------------------------------------------


def text_is(page: Visit, selector: str, wanted: str) -> None:
    page.wait_text(selector, wanted, LIMIT)


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
            KEYS.key(records.GOALS, "g1"): Goal("g1", (f"(done {EVIL})",), 1.0),
            KEYS.key(records.ENDS, "ann", "g1"): Report("g1", "ann", 3, "FAILED", EVIL, 2.0),
        }
        hub.transact(Txn((), tuple(Put(key, records.encode(record)) for key, record in puts.items())))
        command = Command(own.endpoint, "--operators", str(operators), "--port", "0")
        with chromium() as browser:
            page = Visit(browser, f"{command.address}?lang=en")
            text_is(page, "#now-line", "0 of 1 robots joined")
            text_is(page, "#now-trouble", "ann: not seen since")
            text_is(page, "#fleet-goals .more", EVIL)
            assert not page.page.locator("main img").count() and "owned" not in page.page.title()
            page.page.click("#operator")
            page.page.fill("#token", "long enough for a token")
            page.page.click("#sign-in button[type=submit]")
            text_is(page, "#operator", "Ana")
            assert not page.page.is_visible("#stop")
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
            text_is(page, "#now-line", "0 of 1 robots joined")
            page.wait("() => !document.getElementById('fleet').hasAttribute('data-silent')")
            assert page.complaints == []
            page.close()
        assert command.end()[0] == 0
    finally:
        if command is not None and command.process.poll() is None:
            command.process.kill()
        hub.close()
        own.close()


def test_a_hub_that_hangs_is_noticed() -> None:
    own = EtcdProcess()
    client = FleetClient("lab", [own.endpoint])
    try:
        assert client.wait_for_hub(LIMIT)
        own.hang()
        assert client.wait(lambda: client.missing == "etcd does not answer in time", LIMIT), client.missing
        own.resume()
        assert client.wait_for_hub(LIMIT)
    finally:
        client.close()
        own.close()

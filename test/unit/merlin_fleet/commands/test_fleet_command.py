# SPDX-License-Identifier: Apache-2.0
"""Clients and the command over a real etcd: goals sent, listed, followed, cancelled, and done by robots."""

import re
import shlex
import subprocess
import threading
import uuid
from pathlib import Path
from typing import Callable, Iterator, List, Optional, Tuple

import pytest

from merlin_fleet.commands.fleet_command import _parser, main, words
from merlin_fleet.core.agent import Agent, Rules
from merlin_fleet.core.auction import AuctionTimes
from merlin_fleet.core.records import SCHEMAS, Facts, Goal, Keys, Profile, Schema, encode
from merlin_fleet.core.reporting import Outbox
from merlin_fleet.core.robot_lease import LeaseTimes
from merlin_fleet.core.store import Put, Txn
from merlin_fleet.core.view import FleetGoalState
from merlin_fleet.fleet_client import FleetClient, FleetError
from merlin_fleet.fleet_request import FleetRequest, GoalNews
from merlin_fleet.fleet_robot import FleetRobot, FleetStatus
from merlin_fleet.hub import EtcdHub
from merlin_fleet.sqlite_outbox import SqliteOutbox
from merlin_test import LONG
from merlin_test.etcd_process import EtcdProcess
from merlin_test.ports import free_ports

pytestmark = pytest.mark.processes
PAGE = (Path(__file__).resolve().parents[4] / "docs" / "fleet.md").read_text(encoding="utf-8")
#: A test machine may stand still for many seconds.
RULES = Rules(LeaseTimes(ttl=60.0, renew_every=0.5, stop_time=1.0), AuctionTimes(0.1, 30.0))


class TestBody:
    """Executes goals: one of `(hold)` runs until it is stopped, another one has succeeded at once."""

    __test__ = False

    def cost(self, goal: Goal, behind: Tuple[Goal, ...]) -> Tuple[Optional[float], str]:
        return 1.0, ""

    def begin(self, goal: Goal, ended: Callable[[bool, str, str], None]) -> None:
        self.ended = ended
        if goal.goals != ("(hold)",):
            ended(True, "SUCCEEDED", "")

    def stop(self, goal: str, reason: str) -> None:
        self.ended(False, "CANCELLED", reason)


class Lab:
    """A hub, a fleet of a name of its own, a client, robots."""

    def __init__(self, etcd: EtcdProcess) -> None:
        self.etcd = etcd
        self.fleet = uuid.uuid4().hex
        self.client = FleetClient(self.fleet, [etcd.endpoint])
        self.robots: List[FleetRobot] = []
        self.statuses: List[FleetStatus] = []

    def robot(self, name: str, domain: str = "", outbox: Optional[Outbox] = None) -> None:
        profile = Profile(name, capabilities=("arm",), domain=domain)
        agent = Agent(self.fleet, profile, uuid.uuid4().hex, outbox or Outbox(), RULES)
        hub = EtcdHub(agent.keys.root, [self.etcd.endpoint], timeout=20.0)
        robot = FleetRobot(agent, hub, TestBody(), print, on_status=self.statuses.append)
        self.robots.append(robot)
        robot.start()

    def write(self, *puts: Put) -> None:
        """Writes records into the hub, as another program may do."""
        hub = EtcdHub(Keys(self.fleet).root, [self.etcd.endpoint], timeout=20.0)
        try:
            hub.transact(Txn((), puts))
        finally:
            hub.close()

    def run(self, what: str, *arguments: str) -> int:
        return main([what, "--hub", self.etcd.endpoint, "--fleet", self.fleet, *arguments])

    def close(self) -> None:
        for robot in self.robots:
            robot.close()
        self.client.close()


@pytest.fixture(scope="module")
def etcd() -> Iterator[EtcdProcess]:
    made = EtcdProcess()
    yield made
    made.close()


@pytest.fixture
def lab(etcd: EtcdProcess) -> Iterator[Lab]:
    made = Lab(etcd)
    yield made
    made.close()


def test_a_client_sends_and_gets_the_end(lab: Lab, tmp_path: object) -> None:
    outbox = SqliteOutbox(f"{tmp_path}/outbox.sqlite")
    lab.robot("r1", outbox=outbox)
    done = threading.Event()
    reported: List[FleetRequest] = []
    request = lab.client.send("(done a)", on_done=lambda it: (reported.append(it), done.set())[0])
    assert done.wait(LONG)
    assert reported == [request]
    assert request.wait(0.0)
    assert request.result is not None
    assert (request.result.robot, request.result.outcome) == ("r1", "SUCCEEDED")
    assert lab.client.execute(["(done b)", "(done c)"], timeout=LONG).outcome == "SUCCEEDED"
    assert [robot.name for robot, _ in lab.client.robots()] == ["r1"]
    assert any(status.joined for status in lab.statuses)


def test_a_callback_that_raises_does_not_keep_the_client_from_hearing_more(
    lab: Lab, capsys: pytest.CaptureFixture
) -> None:
    def raises(*_: object) -> None:
        raise KeyError("a mistake of the application")

    lab.client.listen(raises)
    lab.robot("r1")
    lab.client.send("(done a)", on_done=raises)
    second = lab.client.send("(done b)")
    assert second.wait(LONG)
    assert not lab.client.missing
    assert "a mistake of the application" in capsys.readouterr().err


def test_a_goal_whose_change_comes_while_its_end_is_looked_up_is_not_removed(lab: Lab) -> None:
    request = lab.client.send("(done a)")
    assert lab.client.wait(lambda: request.news, LONG)
    late = FleetRequest(LateNews(lab.client), request.id, request.written)
    assert late.result is None
    assert not late.done


class LateNews:
    """A client that hears of a goal right after it was asked for it."""

    def __init__(self, client: FleetClient) -> None:
        self._client = client
        self.revision = self.stores = 0

    def news(self, goal: str) -> Optional[GoalNews]:
        known, self.revision = self.revision > 0, self._client.revision
        return self._client.news(goal) if known else None


def test_records_that_are_strange_are_listed(lab: Lab, capsys: pytest.CaptureFixture) -> None:
    keys = Keys(lab.fleet)
    robot, goal = Profile("r7", heard=1e308), Goal("g7", ("(done\n\x1b[2Ja)",), 0.0)
    lab.write(Put(keys.key("robots", "r7"), encode(robot)), Put(keys.key("goals", "g7"), encode(goal)))
    assert lab.run("list") == 0
    listed = (
        "g7  open, no robot is joined  (done  [2Ja)\nrobot r7  not joined, last seen at 1e+308 s since 1970\n"
    )
    assert capsys.readouterr().out == listed


def test_what_times_out_is_cancelled_at_its_robot(lab: Lab) -> None:
    lab.robot("r1")
    request = lab.client.send("(hold)")
    assert lab.client.wait(lambda: request.news and request.news.owner == "r1", LONG)
    lab.client.cancel_all()
    assert request.wait(LONG)
    assert request.result is not None
    assert request.result.outcome == "CANCELLED"


def test_a_goal_of_another_domain_is_refused_and_the_reason_is_shown(lab: Lab) -> None:
    lab.robot("r1", domain="home@12345678")
    other = lab.client.send("(done a)", domain="restaurant")
    assert lab.client.wait(lambda: other.news and other.news.refusals, LONG)
    assert other.news is not None
    assert other.news.refusals == {"r1": "it is of the domain restaurant, the robot has home@12345678"}
    (why,) = other.news.refusals.values()
    assert words(other.news) == f"open, no robot that is joined can do it (r1: {why})"
    for same in ("home", "home@12345678"):
        assert lab.client.execute("(done a)", LONG, domain=same).outcome == "SUCCEEDED"
    older = lab.client.send("(done a)", domain="home@87654321")
    assert lab.client.wait(lambda: older.news and older.news.refusals, LONG)


def test_the_command_sends_lists_follows_and_cancels(lab: Lab, capsys: pytest.CaptureFixture) -> None:
    robot = Profile("r1", ("a",), ("arm",))
    lab.write(Put(Keys(lab.fleet).key("robots", "r1"), encode(robot)))
    options = ("--begin-by", "600", "--value", "2.5", "--robot", "r1", "--group", "a", "--needs", "arm")
    assert lab.run("send", "(done a)", *options) == 0
    goal_id = capsys.readouterr().out.strip()
    assert lab.client.wait(lambda: lab.client.news(goal_id), LONG)
    news = lab.client.news(goal_id)
    assert news is not None
    assert news.state is FleetGoalState.OPEN
    goal = news.goal
    assert (goal.value, goal.robot, goal.groups, goal.needs) == (2.5, "r1", ("a",), ("arm",))
    assert goal.deadline == pytest.approx(goal.sent + 600.0)
    assert lab.run("list") == 0
    assert capsys.readouterr().out.splitlines()[0] == f"{goal_id}  open, no robot is joined  (done a)"
    assert lab.run("cancel", goal_id) == 0
    assert lab.run("follow", goal_id) == 1
    assert capsys.readouterr().out == "CANCELLED: no robot has it\n"
    assert lab.run("cancel", goal_id) == 2
    assert "has ended already: CANCELLED" in capsys.readouterr().err


@pytest.mark.parametrize("wanted", [("--needs", "wings"), ("--group", "night")])
def test_a_goal_that_no_robot_can_take_is_reported(
    lab: Lab, capsys: pytest.CaptureFixture, wanted: Tuple[str, str]
) -> None:
    assert lab.run("send", "(done a)", *wanted) == 0
    assert capsys.readouterr().err.endswith("it waits for one; the robots of this fleet: none\n")
    lab.robot("r1")
    assert lab.client.wait(lambda: any(joined for _, joined in lab.client.robots()), LONG)
    assert lab.run("send", "(done a)", *wanted) == 0
    assert capsys.readouterr().err.endswith("it waits for one; the robots of this fleet: r1\n")
    assert lab.run("send", "(done a)") == 0
    assert capsys.readouterr().err == ""


def test_a_goal_that_no_robot_knows_is_not_sent(lab: Lab, capsys: pytest.CaptureFixture) -> None:
    lab.robot("r1")
    lab.robots[0].tell(SCHEMAS, Schema("(define (domain d) (:predicates (done ?x)))", ("a object",)))
    assert lab.client.wait(lambda: refused(lab.client, "(flies a)"), LONG)
    assert lab.run("send", "(flies a)") == 2
    said = capsys.readouterr()
    assert said.err == "fleet send: r1: (flies a): unknown predicate 'flies'; there is done\n"
    assert (said.out, lab.client.goals()) == ("", [])
    assert lab.run("send", "(done a)", "--follow") == 0


def refused(client: FleetClient, text: str) -> bool:
    """Whether the client knows that no robot of the fleet can mean a goal."""
    try:
        client.check(Goal("", (text,), 0.0))
    except FleetError:
        return True
    return False


def test_follow_ends_with_the_goal(lab: Lab, capsys: pytest.CaptureFixture) -> None:
    lab.robot("r1")
    assert lab.run("send", "(done a)", "--follow") == 0
    assert capsys.readouterr().out.splitlines()[-1] == "SUCCEEDED by r1"
    assert lab.run("list") == 0
    assert capsys.readouterr().out.splitlines()[-1] == "robot r1  joined"


def test_ctrl_c_ends_follow_and_not_the_goal(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    request = lab.client.send("(hold)")

    def interrupted(*_: object) -> bool:
        raise KeyboardInterrupt

    monkeypatch.setattr("merlin_fleet.commands.fleet_command.follow", interrupted)
    assert lab.run("follow", request.id) == 130
    assert not request.done


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("send", "(done a"), "fleet send: goal:1:1: "),
        (("send", "(done a)", "--robot", "a/b"), "fleet send: the robot 'a/b' is not a word"),
        (("send", "(done a)", "--group", ""), "fleet send: the group '' is not a name: no robot can have it"),
        (("send", "(done a)", "--needs", "a,b"), "fleet send: the capability 'a,b' is not a name"),
        (("send", "(done a)", "--domain", "ho me"), "fleet send: the domain 'ho me' is not a name"),
        (
            ("send", "(done a)", "--robot", "r2"),
            "fleet send: there is no robot 'r2' in the fleet; there is none",
        ),
        (("list", "--hub", "127.0.0.1:99999"), "fleet list: '127.0.0.1:99999' is not the address of a hub"),
        (("list", "--hub", "127.0.0.1:0"), "fleet list: '127.0.0.1:0' is not the address of a hub"),
        (
            ("page", "--page-key", "key.pem"),
            "fleet page: a key is given, but no certificate; give both --page-certificate … and --page-key …",
        ),
        (("page", "--host", "300.1.1.1"), "fleet page: the address '300.1.1.1' cannot be used: "),
        (("follow", "nothing"), "fleet follow: there is no goal 'nothing' in the fleet"),
        (("cancel", "nothing"), "fleet cancel: there is no goal 'nothing' in the fleet"),
        (
            ("list", "--hub", "robot.example.org:2379"),
            "fleet list: without certificates only an etcd on this",
        ),
        (("list", "--fleet", "a b"), "fleet list: the fleet 'a b' is not a word"),
        (
            ("list", "--hub", "localhost"),
            "fleet list: 'localhost' is not the address of a hub; write hub.lab",
        ),
        (("list", "--hub", "https://hub.lab:2379"), "fleet list: 'https://hub.lab:2379' is not the address"),
        (("list", "--hub", "hub lab:2379"), "fleet list: 'hub lab:2379' is not the address of a hub"),
        (("list", "--hub", ","), "fleet list: no etcd is named"),
        (("list", "--ca", "ca.pem"), "fleet list: --ca, --certificate and --key belong together"),
    ],
)
def test_mistakes_are_one_clear_line(
    lab: Lab, capsys: pytest.CaptureFixture, arguments: Tuple[str, ...], message: str
) -> None:
    assert lab.run(*arguments) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(message)
    assert ":=" not in line


@pytest.mark.parametrize(
    ("option", "message"),
    [
        (("--begin-by", "soon"), "argument --begin-by: soon is not a number of seconds in the future"),
        (("--begin-by", "-1"), "argument --begin-by: -1 is not a number of seconds in the future"),
        (
            ("--deadline", "600"),
            "is not done by a time; --begin-by 600 ends it unless it is begun then",
        ),
        (("--value", "inf"), "argument --value: inf is not a number"),
    ],
)
def test_wrong_options_are_named(capsys: pytest.CaptureFixture, option: tuple, message: str) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["send", "(done a)", *option])
    assert ended.value.code == 2
    assert capsys.readouterr().err.splitlines()[-1].endswith(message)


def test_the_number_of_goals_to_keep_is_a_whole_one(capsys: pytest.CaptureFixture) -> None:
    with pytest.raises(SystemExit):
        main(["keep", "--goals", "1.5"])
    assert capsys.readouterr().err.endswith("argument --goals: 1.5 is not a whole number from 0 on\n")


def test_an_open_goal_that_no_robot_can_do_says_so(lab: Lab) -> None:
    lab.robot("r1")
    lab.robot("r2")
    request = lab.client.send("(done a)", needs=("wings",))

    def said() -> str:
        return words(request.news) if request.news else ""

    expected = (
        "open, no robot that is joined can do it (r1: it needs wings; r2: it needs wings)",
        "open, no robot is joined",
    )
    assert lab.client.wait(lambda: said() == expected[0], LONG), said()
    for robot in lab.robots:
        robot.close()
    lab.robots.clear()
    assert lab.client.wait(lambda: said() == expected[1], LONG), said()


def test_a_hub_that_is_not_there(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture) -> None:
    monkeypatch.setattr("merlin_fleet.commands.fleet_command.LIMIT", 0.1)
    assert main(["list", "--hub", "127.0.0.1:1"]) == 2
    assert capsys.readouterr().err.startswith("fleet list: no hub at 127.0.0.1:1: ")


def test_shared_facts_are_listed_with_their_age(lab: Lab, capsys: pytest.CaptureFixture) -> None:
    keys = Keys(lab.fleet)
    hub = EtcdHub(keys.root, [lab.etcd.endpoint], timeout=20.0)
    lab.robot("r1")
    assert lab.client.wait(lambda: any(joined for _, joined in lab.client.robots()), LONG)
    lab.robots[0].know("door_open", ("ward", "lab main"), 7)
    absent = Facts("r2", "delivered", ("box_1",), 3, "gone")
    hub.transact(Txn(puts=(Put(keys.key("facts", "r2", "delivered"), encode(absent)),)))
    hub.close()
    assert lab.client.wait(lambda: len(lab.client.facts()) == 2, LONG)
    assert lab.run("facts") == 0
    assert capsys.readouterr().out.splitlines() == [
        "door_open of r1, version 7  current",
        "  (door_open ward)",
        "  (door_open lab main)",
        "delivered of r2, version 3  old",
        "  (delivered box_1)",
    ]


def test_a_fleet_of_another_protocol_is_not_written_to(lab: Lab) -> None:
    keys = Keys(uuid.uuid4().hex)
    hub = EtcdHub(keys.root, [lab.etcd.endpoint], timeout=20.0)
    hub.transact(Txn(puts=(Put(keys.key("about"), '{"protocol": 99, "id": "x"}'),)))
    client = FleetClient(keys.root.split("/")[2], [lab.etcd.endpoint])
    try:
        assert not client.wait_for_hub(LONG)
        client.on_resumed()  # a connection that was cut and mended changes nothing of that
        with pytest.raises(FleetError, match="cannot be used: it is of protocol 99"):
            client.send("(done a)")
        assert [item.key for item in hub.read().items] == [keys.key("about")]
    finally:
        client.close()
        hub.close()


def test_the_program_of_the_page(lab: Lab, capsys: pytest.CaptureFixture) -> None:
    lab.robot("r1")
    (code,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    used = code.replace('"fleet"', repr(lab.fleet)).replace("127.0.0.1:2379", lab.etcd.endpoint)
    assert used.count(lab.fleet) == used.count(lab.etcd.endpoint) == 1
    known: dict = {}
    exec(used, known)
    known["client"].close()
    assert capsys.readouterr().out == "r1 SUCCEEDED\n"


def test_the_commands_of_the_page_have_these_options() -> None:
    lines = re.findall(r"^rosrun merlin_fleet fleet (.*)$", PAGE, re.MULTILINE)
    asked = [_parser().parse_args(shlex.split(line)).what for line in lines]
    assert asked == [
        "send",
        "list",
        "follow",
        "cancel",
        "list",
        "keep",
        "forget",
        "forget",
        "facts",
        "page",
        "page",
    ]


def test_the_hub_of_the_page(tmp_path: Path) -> None:
    line, _ = re.findall(r"^etcd .*$", PAGE, re.MULTILINE)  # the other one is with certificates
    port, peer = free_ports(2)
    line = line.replace("~/.ros/merlin/hub", str(tmp_path / "hub")).replace("2379", str(port))
    peers = ["--listen-peer-urls", f"http://127.0.0.1:{peer}"]  # another one may have the usual port
    words_of_page = [*shlex.split(line), *peers]
    process = subprocess.Popen(words_of_page, stdout=subprocess.DEVNULL, stderr=subprocess.STDOUT)
    client = FleetClient("lab", [f"127.0.0.1:{port}"])
    try:
        assert client.wait_for_hub(LONG)
        assert client.send("(done a)").result is None
    finally:
        client.close()
        process.kill()
        process.wait()

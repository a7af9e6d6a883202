# SPDX-License-Identifier: Apache-2.0
"""Robots of a fleet over a real etcd: which one does what, and what happens when hub or robot stop."""

import os
import queue
import subprocess
import threading
import time
import uuid
from typing import Any, Callable, Dict, Iterator, List, Optional, Tuple

import pytest

from merlin_fleet.core import records
from merlin_fleet.core.agent import Agent, Rules
from merlin_fleet.core.auction import AuctionTimes
from merlin_fleet.core.records import Goal, Keys, Profile
from merlin_fleet.core.reporting import Outbox
from merlin_fleet.core.robot_lease import LeaseTimes
from merlin_fleet.core.store import Change, Compare, Put, Snapshot, Txn
from merlin_fleet.core.view import FleetView
from merlin_fleet.etcd_messages import message
from merlin_fleet.fleet_robot import FleetRobot
from merlin_fleet.hub import EtcdHub
from merlin_fleet.hub_watch import Listener
from merlin_test import LONG
from merlin_test.etcd_process import EtcdProcess

pytestmark = pytest.mark.processes

KEYS = Keys("lab")
#: A test machine may stand still for many seconds.
RULES = Rules(LeaseTimes(ttl=60.0, renew_every=0.5, stop_time=1.0), AuctionTimes(30.0, 30.0))
SHORT = Rules(LeaseTimes(ttl=4.0, renew_every=0.5, stop_time=1.0))


class TestBody:
    """Executes goals: each runs until the test ends it, or it is stopped."""

    __test__ = False

    def __init__(self, price: float) -> None:
        self.price = price
        self.running: Dict[str, Callable[[bool, str, str], None]] = {}
        self.begun: List[str] = []
        self.stopped: List[str] = []
        self.changed = threading.Condition()

    def cost(self, goal: Goal, behind: Tuple[Goal, ...]) -> Tuple[Optional[float], str]:
        return self.price * (1 + len(behind)), ""

    def begin(self, goal: Goal, ended: Callable[[bool, str, str], None]) -> None:
        with self.changed:
            self.begun.append(goal.id)
            self.running[goal.id] = ended
            self.changed.notify_all()

    def stop(self, goal: str, reason: str) -> None:
        with self.changed:
            ended = self.running.pop(goal, None)
            self.stopped.append(reason)
            self.changed.notify_all()
        if ended is not None:
            ended(False, "CANCELLED", reason)

    def succeed(self, goal: str) -> None:
        self.end(goal, "SUCCEEDED", "")

    def end(self, goal: str, outcome: str, reason: str) -> None:
        with self.changed:
            assert self.changed.wait_for(lambda: goal in self.running, LONG)
            ended = self.running.pop(goal)
        ended(outcome == "SUCCEEDED", outcome, reason)


class Watcher(Listener):
    """Waits until a condition holds of the keys."""

    def __init__(self) -> None:
        self.view = FleetView(KEYS)
        self._changed = threading.Condition()

    def on_connected(self, snapshot: Snapshot) -> None:
        with self._changed:
            self.view = FleetView.of(KEYS, snapshot)
            self._changed.notify_all()

    def on_changed(self, changes: Tuple[Change, ...]) -> None:
        with self._changed:
            self.view.apply(changes)
            self._changed.notify_all()

    def until(self, holds: Callable[[FleetView], Any]) -> Any:
        with self._changed:
            assert self._changed.wait_for(lambda: holds(self.view), LONG), vars(self.view)
            return holds(self.view)


class Lab:
    """A hub, robots, and a client."""

    def __init__(self) -> None:
        self.etcd = EtcdProcess()
        self.said: List[str] = []
        self.heard = threading.Event()
        self.robots: Dict[str, FleetRobot] = {}
        self.hub = EtcdHub(KEYS.root, [self.etcd.endpoint], timeout=20.0)
        self.watcher = Watcher()
        self.hub.follow(self.watcher)

    def robot(
        self,
        name: str,
        price: float,
        rules: Rules = RULES,
        timeout: float = 20.0,
        outbox: Optional[Outbox] = None,
    ) -> TestBody:
        body = TestBody(price)
        agent = Agent("lab", Profile(name), uuid.uuid4().hex, outbox or Outbox(), rules)
        hub = EtcdHub(KEYS.root, [self.etcd.endpoint], timeout=timeout)
        self.robots[name] = FleetRobot(agent, hub, body, self._say)
        self.robots[name].start()
        return body

    def _say(self, text: str) -> None:
        self.said.append(text)
        self.heard.set()

    def send(self, name: str, **more: Any) -> None:
        goal = Goal(name, (f"(done {name})",), 0.0, **more)
        key = KEYS.key(records.GOALS, name)
        assert self.hub.transact(Txn((Compare(key, 0),), (Put(key, records.encode(goal)),))).done

    def revoke(self, robot: str, goal: str) -> bool:
        """Ends the lease of a claim, as anyone can who may write the robot's keys.

        :return: False: it has ended itself.
        """
        key = KEYS.key(records.CLAIMS, robot, goal).encode()
        for claim in self.hub.ask("KV/Range", message("RangeRequest", key=key)).kvs:
            command = ["etcdctl", "--endpoints", self.etcd.endpoint, "lease", "revoke", f"{claim.lease:x}"]
            env = dict(os.environ, ETCDCTL_API="3")
            return subprocess.run(command, env=env, check=False, capture_output=True).returncode == 0
        return False

    def close(self) -> None:
        for robot in self.robots.values():
            robot.close()
        self.hub.close()
        self.etcd.close()


@pytest.fixture
def lab() -> Iterator[Lab]:
    made = Lab()
    yield made
    made.close()


def test_the_cheapest_robot_does_it_and_reports(lab: Lab) -> None:
    lab.robot("dear", 9.0)
    cheap = lab.robot("cheap", 2.0)
    lab.watcher.until(lambda view: view.offers.of("dear") and view.offers.of("cheap"))
    lab.send("a")
    cheap.succeed("a")
    end = lab.watcher.until(lambda view: view.ends.get("a"))
    assert (end.robot, end.outcome) == ("cheap", "SUCCEEDED")
    assert not lab.watcher.view.claims


def test_a_hub_that_hangs_stops_what_runs_and_nothing_is_lost(lab: Lab) -> None:
    body = lab.robot("r1", 1.0, SHORT, timeout=1.0)
    lab.send("a")
    with body.changed:
        assert body.changed.wait_for(lambda: "a" in body.running, LONG)
    lab.etcd.hang()
    with body.changed:
        assert body.changed.wait_for(lambda: body.stopped, LONG)
    assert "the lease of the fleet ends" in body.stopped
    lab.etcd.resume()
    body.succeed("a")
    assert lab.watcher.until(lambda view: view.ends.get("a")).outcome == "SUCCEEDED"


def test_a_robot_whose_lease_is_revoked_stops_at_once(lab: Lab) -> None:
    body = lab.robot("r1", 1.0)
    lab.send("a")
    with body.changed:
        assert body.changed.wait_for(lambda: "a" in body.running, LONG)
    assert lab.revoke("r1", "a")
    with body.changed:
        assert body.changed.wait_for(lambda: body.stopped, LONG)
    assert body.stopped[0] == "the fleet has taken it away"
    body.succeed("a")  # it knows that it stands, and has it again
    assert lab.watcher.until(lambda view: view.ends.get("a")).outcome == "SUCCEEDED"


def test_the_next_robot_waits_until_one_whose_lease_was_revoked_must_stand(lab: Lab) -> None:
    first = lab.robot("r1", 1.0, SHORT)
    lab.send("a")
    with first.changed:
        assert first.changed.wait_for(lambda: "a" in first.running, LONG)
    second = lab.robot("r2", 5.0, SHORT)
    lab.watcher.until(lambda view: view.lives.get("r2") and view.claims.get("a"))
    first.price = None  # type: ignore[assignment]  # it does not take the goal again
    at = time.monotonic()
    revoked = lab.revoke("r1", "a")
    second.succeed("a")
    assert first.stopped
    assert time.monotonic() - at >= SHORT.lease.ttl or not revoked
    assert lab.watcher.until(lambda view: view.ends.get("a")).robot == "r2"


def test_a_reason_that_no_record_can_hold_is_reported_as_far_as_possible(lab: Lab) -> None:
    body = lab.robot("r1", 1.0)
    lab.send("a")
    body.end("a", "ACTION_FAILED", "the door \ud800 " + 2_000_000 * "x")
    end = lab.watcher.until(lambda view: view.ends.get("a"))
    assert end.outcome == "ACTION_FAILED"
    assert end.reason.startswith("the door ? xxx")
    assert not lab.watcher.view.claims


def test_many_keys_that_are_read_anew_do_not_delay_a_stop(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    body = lab.robot("r1", 1.0, SHORT, timeout=1.0)
    lab.send("a")
    with body.changed:
        assert body.changed.wait_for(lambda: "a" in body.running, LONG)
    of, snapshot = FleetView.of, lab.hub.read()
    reads, has_stopped = threading.Event(), threading.Event()

    def slow(*given: Any) -> FleetView:
        reads.set()
        has_stopped.wait(LONG)
        return of(*given)

    monkeypatch.setattr(FleetView, "of", slow)
    watch = threading.Thread(target=lab.robots["r1"].on_connected, args=(snapshot,))
    watch.start()
    assert reads.wait(LONG)
    lab.etcd.hang()
    try:
        with body.changed:
            assert body.changed.wait_for(lambda: "the lease of the fleet ends" in body.stopped, LONG / 2)
    finally:
        has_stopped.set()
        watch.join(LONG)
        lab.etcd.resume()


class HangingOutbox(Outbox):
    """An outbox whose disk hangs once."""

    def __init__(self) -> None:
        super().__init__()
        self.hangs, self.goes_on = threading.Event(), threading.Event()

    def remove(self, goal: str, epoch: int) -> None:
        self.hangs.set()
        self.goes_on.wait(LONG)
        super().remove(goal, epoch)


def test_a_disk_that_hangs_delays_no_stop(lab: Lab) -> None:
    outbox = HangingOutbox()
    body = lab.robot("r1", 1.0, SHORT, outbox=outbox)
    lab.send("a", value=1.0)
    lab.send("b")
    try:
        body.succeed("a")
        assert outbox.hangs.wait(LONG)
        with body.changed:
            assert body.changed.wait_for(lambda: body.stopped, LONG), "its lease is not renewed"
            assert body.stopped == ["the lease of the fleet ends"] and not body.running
    finally:
        outbox.goes_on.set()
    body.succeed("b")  # which the stop has not ended
    assert lab.watcher.until(lambda view: view.ends.get("b")).outcome == "SUCCEEDED"


class SlowOutbox(Outbox):
    """An outbox whose disk takes longer than a lease to add a report."""

    def __init__(self) -> None:
        super().__init__()
        self.late = 0.0

    def boot_time(self) -> float:
        return time.clock_gettime(time.CLOCK_BOOTTIME) + self.late

    def add(self, report: records.Report, final: bool) -> str:
        self.late += 2.0 * RULES.lease.ttl
        return super().add(report, final)


def test_what_was_decided_before_the_disk_hung_does_not_run(
    lab: Lab, monkeypatch: pytest.MonkeyPatch
) -> None:
    outbox = SlowOutbox()
    monkeypatch.setattr("merlin_fleet.fleet_robot.boot_time", outbox.boot_time)
    body = lab.robot("r1", 1.0, outbox=outbox)
    lab.send("a", value=1.0)
    lab.send("b")
    lab.watcher.until(lambda view: "b" in view.claims)
    body.succeed("a")
    body.succeed("b")  # under a lease that was renewed after that
    assert lab.watcher.until(lambda view: view.ends.get("b")).outcome == "SUCCEEDED"
    assert body.begun == ["a", "b"] and not body.stopped


def test_a_goal_to_finish_goes_on_without_the_hub_and_is_reported_afterwards(lab: Lab) -> None:
    body = lab.robot("r1", 1.0)
    lab.send("a", finish=True)
    with body.changed:
        assert body.changed.wait_for(lambda: "a" in body.running, LONG)
    lab.etcd.kill()
    body.succeed("a")
    lab.etcd.start()
    assert lab.watcher.until(lambda view: view.ends.get("a")).robot == "r1"
    assert not body.stopped


def test_a_robot_whose_deciding_thread_fails_stops_what_runs(
    lab: Lab, monkeypatch: pytest.MonkeyPatch
) -> None:
    body = lab.robot("r1", 1.0)
    lab.send("a")
    with body.changed:
        assert body.changed.wait_for(lambda: "a" in body.running, LONG)
    robot = lab.robots.pop("r1")
    failed: queue.Queue[str] = queue.Queue()
    monkeypatch.setattr(robot, "_on_failed", failed.put)

    def fails(*_: Any) -> None:
        raise KeyError("a mistake of the program")

    monkeypatch.setattr(robot._agent, "handle", fails)
    assert "a mistake of the program" in failed.get(timeout=LONG)
    assert body.stopped == ["the robot's part in the fleet has failed"]
    assert not body.running
    robot.close(0.1)
    # Its stop is not known to have ended: the goal stays owned as long as the lease.
    # The watcher may not have heard of the claim yet.
    assert "a" in FleetView.of(KEYS, lab.hub.read()).claims


def test_a_robot_whose_cost_cannot_be_told_says_why(lab: Lab) -> None:
    body = lab.robot("r1", 1.0)
    body.price = None  # type: ignore[assignment]
    lab.send("a")
    bid = lab.watcher.until(lambda view: (view.offers.of("r1") or records.Bids()).of.get("a"))
    assert bid.cost is None
    assert "TypeError" in bid.reason


def test_a_robot_without_its_hub_begins_and_joins_later(lab: Lab) -> None:
    lab.etcd.kill()
    lab.robot("r1", 1.0)
    assert lab.heard.wait(LONG)
    lab.etcd.start()
    lab.watcher.until(lambda view: view.lives.get("r1"))
    assert lab.said[0].startswith("without the hub: etcd cannot be reached")
    # Once, though each attempt fails; a machine that stalls may lose the hub again, for another reason.
    assert sum("cannot be reached" in text for text in lab.said) == 1


def test_a_robot_that_leaves_gives_back_what_it_owns(lab: Lab) -> None:
    first = lab.robot("r1", 1.0)
    lab.send("a")
    with first.changed:
        assert first.changed.wait_for(lambda: "a" in first.running, LONG)
    second = lab.robot("r2", 5.0)
    lab.watcher.until(lambda view: view.lives.get("r2"))  # one that begins later has not heard of it
    lab.robots.pop("r1").close(LONG)
    assert first.stopped == ["the robot leaves the fleet"]
    second.succeed("a")
    assert lab.watcher.until(lambda view: view.ends.get("a")).robot == "r2"


def test_a_robot_that_leaves_tells_first_what_it_has_done(lab: Lab) -> None:
    body = lab.robot("r1", 1.0)
    lab.send("a")
    body.succeed("a")
    lab.robots.pop("r1").close(LONG)
    assert lab.watcher.until(lambda view: view.ends.get("a")).outcome == "SUCCEEDED"
    assert not lab.watcher.view.late


def test_another_fleet_of_the_same_name_is_not_joined(lab: Lab) -> None:
    lab.robot("r1", 1.0)
    lab.watcher.until(lambda view: view.offers.of("r1") is not None)
    said: queue.Queue[str] = queue.Queue()
    agent = Agent("lab", Profile("r2"), "x", Outbox(), RULES, fleet_id="another")
    hub = EtcdHub(KEYS.root, [lab.etcd.endpoint], timeout=20.0)
    robot = FleetRobot(agent, hub, TestBody(1.0), said.put)
    robot.start()
    assert "the hub is not used" in said.get(timeout=LONG)
    robot.close()
    assert not [item.key for item in lab.hub.read().items if item.key.endswith("/r2")]

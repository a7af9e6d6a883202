# SPDX-License-Identifier: Apache-2.0
"""A robot of a fleet, without ROS: runs the agent over a hub and a body.

One thread decides, and waits for nothing but the disk of the outbox; calls to the hub, renewals of the lease,
its time and costs have a thread each. So a hub that hangs cannot delay the stop of what the lease no longer
covers; nor can a disk: where the deciding thread is late with a stop, another one stops it.
"""

import contextlib
import functools
import math
import queue
import threading
import time
import traceback
from typing import Callable, List, NamedTuple, Optional, Protocol, Tuple, Union

from merlin_fleet.certified import HubError
from merlin_fleet.core import events as ev
from merlin_fleet.core.agent import Agent
from merlin_fleet.core.possession import CANCELLED, LEASE_ENDS
from merlin_fleet.core.records import Goal, Halt, Schema, Status
from merlin_fleet.core.store import Change, Snapshot
from merlin_fleet.core.view import FleetView
from merlin_fleet.etcd_messages import HubFails, HubFull, HubRefuses, LeaseUnknown
from merlin_fleet.event_inbox import EventInbox
from merlin_fleet.hub import EtcdHub
from merlin_fleet.hub_watch import Listener

Stopped = Callable[[bool, str, str], None]
LATE = 0.2  # s after the end of the lease from which the deciding thread counts as late with a stop


class Body(Protocol):
    """Executes goals of the fleet on one robot, and estimates what they cost."""

    def cost(self, goal: Goal, behind: Tuple[Goal, ...]) -> Tuple[Optional[float], str]:
        """What a goal costs behind others, s; None, and why it cannot be done. In a thread of its own."""

    def begin(self, goal: Goal, ended: Stopped) -> None:
        """Begins a goal and returns at once; `ended(achieved, outcome, reason)` is called once."""

    def stop(self, goal: str, reason: str) -> None:
        """Stops a goal and returns at once; its end is reported as always."""


class FleetStatus(NamedTuple):
    """How a robot stands in its fleet."""

    connected: bool = False
    refused: str = ""
    """Why it does not join this hub."""
    joined: bool = False
    owned: Tuple[str, ...] = ()
    """The goals that it has; the first one runs."""
    unreported: int = 0
    """Ends that the hub does not have yet."""
    stale: Tuple[str, ...] = ()
    """Shared facts that are older than allowed, in words."""
    clock: str = ""
    """How far its clock is off, in words; empty: it is not."""


def boot_time() -> float:
    """s since the machine began, also while it was suspended. Never set, never back."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


class FleetRobot(Listener):
    """A robot of a fleet.

    :param agent: is used by this object's thread alone.
    :param hub: is closed with this object.
    :param body: executes goals.
    :param say: gets sentences for a person; from the deciding thread.
    :param note_fleet: keeps the fleet's id, when the robot has joined; returns why that failed.
    :param learn: takes all facts of a predicate that another robot writes; returns at once.
    :param on_status: gets the robot's status in the fleet after each change; from the deciding thread.
    :param on_halt: stops the robot and holds its base, and returns at once; calls the function when that has
        come true; until then the stop stays in the hub. :meth:`tell` gets a status that says how it went.
    :param on_failed: is called with the error when the deciding thread has failed; what ran is being stopped.
    """

    def __init__(
        self,
        agent: Agent,
        hub: EtcdHub,
        body: Body,
        say: Callable[[str], None],
        note_fleet: Callable[[str], str] = lambda fleet: "",
        on_status: Callable[[FleetStatus], None] = lambda status: None,
        learn: Callable[[str, Tuple[str, ...]], None] = lambda predicate, facts: None,
        on_failed: Callable[[str], None] = lambda error: None,
        on_halt: Callable[[Halt, Callable[[], None]], None] = lambda halt, obeyed: None,
    ) -> None:
        self._agent = agent
        self._hub = hub
        self._body = body
        self._say = say
        self._note_fleet = note_fleet
        self._on_status = on_status
        self._learn = learn
        self._on_failed = on_failed
        self._on_halt = on_halt
        self._status = FleetStatus()
        self._noted = agent.fleet_id
        self._events = EventInbox(agent.rules.gather_changes)
        self._marks = (f"/{agent.robot.name}", f'"{agent.robot.name}"')
        self._calls: queue.Queue[Optional[ev.Transact]] = queue.Queue()
        self._costs: queue.Queue[Optional[ev.AskCost]] = queue.Queue()
        self._times: queue.Queue[Optional[ev.AskTime]] = queue.Queue()
        self._leases: queue.Queue[Optional[ev.AskLease]] = queue.Queue()
        self._idle = threading.Event()
        self._changed = threading.Condition()  # guards the fields below
        self._leased: Tuple[str, ...] = ()  # goals that run, as long as the lease
        self._stop_at = math.inf
        self._overdue: Tuple[str, ...] = ()  # stopped, which the deciding thread does not know
        self._over = False
        parts = {
            "decisions": self._decide,
            "calls": self._call,
            "costs": self._cost,
            "lease": self._lease,
            "time": self._time,
            "stops": self._stop_overdue,
        }
        self._threads = [
            threading.Thread(target=part, name=f"fleet {name}", daemon=True) for name, part in parts.items()
        ]

    def start(self) -> None:
        """Begins; returns at once, also when there is no hub."""
        for thread in self._threads:
            thread.start()
        self._hub.follow(self)

    def close(self, limit: float = 10.0) -> None:
        """Stops the running execution, gives the owned goals back, and ends.

        :param limit: s for the stop. A goal that has not ended by then stays owned until its lease ends.
        """
        self._events.put(ev.Leaving())
        if self._idle.wait(limit) and self._agent.robot_lease.lease:
            try:
                self._hub.revoke(self._agent.robot_lease.lease)
            except HubError as error:
                self._say(f"what the robot owns is free when its lease ends: {error}")
        self._events.put("end")
        for part in (self._calls, self._costs, self._times):
            part.put(None)
        self._hub.close()
        self._threads[0].join(limit)

    def know(self, predicate: str, facts: Optional[Tuple[str, ...]], version: int) -> None:
        """The knowledge base has these facts of a predicate that this robot writes; None: no answer."""
        self._events.put(ev.Known(predicate, facts, version))

    def tell(self, kind: str, record: Union[Schema, Status]) -> None:
        """The robot says this of itself, until it says something else of this kind."""
        self._events.put(ev.Tell(kind, record))

    # --- changes of the hub

    def on_connected(self, snapshot: Snapshot) -> None:
        """All keys were read. They are looked at here: the deciding thread has a lease to watch."""
        view = FleetView.of(self._agent.keys, snapshot, self._agent.robot)
        self._events.put(ev.Connected(snapshot, view))

    def on_resumed(self) -> None:
        """The hub calls it when changes arrive again after a loss."""
        self._events.put(ev.Resumed())

    def on_changed(self, changes: Tuple[Change, ...]) -> None:
        """The hub calls it with keys that have changed."""
        self._events.put_changes(changes, any(map(self._concerns, changes)))

    def _concerns(self, change: Change) -> bool:
        """Whether a change may be about this very robot, or about a goal that it has."""
        key, value = change.key, change.value
        end, name = self._marks
        mine = key.endswith(end) or (value is not None and name in value)
        return mine or key.rpartition("/")[2] in self._status.owned

    def on_disconnected(self, reason: str) -> None:
        """The hub calls it when it loses its connection, with the reason."""
        self._events.put(ev.Disconnected(reason))

    # --- threads

    def _decide(self) -> None:
        try:
            self._decide_all()
        except Exception:  # whatever it is: without this thread nothing ends with its lease
            error = traceback.format_exc()
            for goal in self._agent.possession.queue():
                with contextlib.suppress(Exception):  # the others are still to be stopped
                    self._body.stop(goal.id, "the robot's part in the fleet has failed")
            self._on_failed(error)
        with self._changed:
            self._over = True
            self._changed.notify()
        self._leases.put(None)

    def _decide_all(self) -> None:
        while True:
            event = self._events.next(max(0.0, self._agent.next_moment() - boot_time()))
            if isinstance(event, str):
                return
            if isinstance(event, ev.Disconnected):
                self._say(f"without the hub: {event.reason}")
            now = boot_time()
            self._agent.wall_offset = time.time() - now
            with self._changed:
                overdue, self._overdue = self._overdue, ()
            self._agent.possession.stopped(*overdue)
            self._carry_out(self._agent.handle(now, event))
            self._note_leased()
            if self._agent.fleet_id != self._noted:
                self._noted = self._agent.fleet_id
                problem = self._note_fleet(self._noted)
                if problem:
                    self._say(f"of which fleet it is will be forgotten: {problem}")
            self._tell_status()
            self._events.took(boot_time() - now)
            if self._agent.leaving and not self._busy():
                self._idle.set()

    def _note_leased(self) -> None:
        leased, stop_at = self._agent.possession.leased(), self._agent.robot_lease.stop_at
        with self._changed:
            if (leased, stop_at) != (self._leased, self._stop_at):
                self._leased, self._stop_at = leased, stop_at
                self._changed.notify()

    def _stop_overdue(self) -> None:
        """Stops what the lease no longer covers, where the deciding thread is late with that."""
        while True:
            with self._changed:
                left = self._stop_at + LATE - boot_time() if self._leased else math.inf
                if self._over:
                    return
                if left > 0.0:
                    self._changed.wait(None if math.isinf(left) else left)
                    continue
                overdue, self._leased = self._leased, ()
                self._overdue += overdue
            for goal in overdue:
                with contextlib.suppress(Exception):  # the others are still to be stopped
                    self._body.stop(goal, LEASE_ENDS)

    def _tell_status(self) -> None:
        agent = self._agent
        owned = tuple(goal.id for goal in agent.possession.queue())
        waiting, stale = len(agent.reporting.waiting), agent.sharing.stale
        refused = agent.refused or agent.denied or agent.full
        status = FleetStatus(
            agent.connected, refused, agent.joined, owned, waiting, stale, agent.clock.problem
        )
        if status != self._status:
            self._status = status
            self._on_status(status)

    def _busy(self) -> bool:
        """Whether something runs, or can be reported or given back to the hub under the present lease."""
        agent = self._agent
        executing = any(owned.executing for owned in agent.possession.owned.values())
        unsaid = bool(agent.reporting.waiting or agent.possession.to_return())
        return executing or (agent.usable and unsaid)

    def _carry_out(self, decisions: List[ev.Decision]) -> None:
        for decision in decisions:
            if isinstance(decision, ev.StopExecution):
                self._body.stop(decision.goal, decision.reason)
            elif isinstance(decision, ev.Begin):
                self._begin(decision.goal)
            elif isinstance(decision, ev.AskLease):
                if self._leases.empty():  # else the last one still waits for the hub
                    self._leases.put(decision)
            elif isinstance(decision, ev.Transact):
                self._calls.put(decision)
            elif isinstance(decision, ev.AskCost):
                self._costs.put(decision)
            elif isinstance(decision, ev.AskTime):
                self._times.put(decision)
            elif isinstance(decision, ev.Obey):
                halt = decision.halt
                self._on_halt(halt, functools.partial(self._events.put, ev.Obeyed(halt.revision)))
            elif isinstance(decision, ev.Learn):
                self._learn(decision.predicate, decision.facts)
            elif isinstance(decision, ev.Say):
                self._say(decision.text)

    def _begin(self, goal: Goal) -> None:
        if goal.finish or boot_time() < self._agent.robot_lease.stop_at:
            self._body.begin(goal, self._ended(goal.id))
            return
        self._agent.possession.stopped(goal.id)  # the disk has hung since it was decided
        self._ended(goal.id)(False, CANCELLED, LEASE_ENDS)

    def _ended(self, goal: str) -> Stopped:
        return lambda achieved, outcome, reason: self._events.put(ev.Ended(goal, achieved, outcome, reason))

    def _call(self) -> None:
        for decision in iter(self._calls.get, None):
            try:
                result = self._hub.transact(decision.txn)
            except HubRefuses as error:
                result = None
                self._events.put(ev.Refused(str(error), decision.tag))
            except HubFull as error:
                result = None
                self._events.put(ev.Full(str(error)))
            except HubFails as error:
                result = None
                self._events.put(ev.Failed(str(error)))
            except HubError:
                result = None  # it may have been done: the keys will show it
            self._events.put(ev.Answered(decision.tag, result))

    def _lease(self) -> None:
        for decision in iter(self._leases.get, None):
            asked_at = boot_time()
            try:
                if decision.lease:
                    lease, ttl = decision.lease, self._hub.renew(decision.lease)
                else:
                    lease, ttl = self._hub.grant(self._agent.rules.lease.kept)
            except LeaseUnknown:
                lease, ttl = decision.lease, 0.0
            except HubFull as error:
                self._events.put(ev.Full(str(error)))
                continue
            except HubError:
                continue  # asked again, soon
            self._events.put(ev.Leased(decision.lease, asked_at, lease if ttl else 0, ttl))

    def _time(self) -> None:
        for _ in iter(self._times.get, None):
            wall: Optional[float] = None
            with contextlib.suppress(HubError):
                wall = self._hub.time()
            self._events.put(ev.Timed(boot_time(), wall))

    def _cost(self) -> None:
        for decision in iter(self._costs.get, None):
            cost: Optional[float] = None
            try:
                cost, reason = self._body.cost(decision.goal, decision.behind)
            except Exception as error:  # a robot without a cost does not bid, and logs why
                reason = f"its cost is not known: {error!r}"
            self._events.put(ev.Costed(decision.goal.id, decision.queue, cost, reason))

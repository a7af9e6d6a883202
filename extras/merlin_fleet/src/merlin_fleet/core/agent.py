# SPDX-License-Identifier: Apache-2.0
"""One robot's part of the protocol (docs/fleet-protocol.md): when it bids, takes, begins, stops, reports.

Every event changes the agent's state; then what follows from the state is decided. A decision that is under
way is not repeated; one that failed is, after a while. So the order of answers and changes does not matter.
"""

from typing import Dict, List, NamedTuple, Optional

from merlin_fleet.core import events as ev
from merlin_fleet.core import records
from merlin_fleet.core.auction import AuctionTimes
from merlin_fleet.core.bidding import Bidding
from merlin_fleet.core.cleaning import FORGET, REMOVE, Cleaning
from merlin_fleet.core.clock import CLOCK_MARGIN, ClockCheck
from merlin_fleet.core.lag import Lag
from merlin_fleet.core.possession import Possession
from merlin_fleet.core.records import Claim, Keys, Profile
from merlin_fleet.core.reporting import Outbox, Reporting
from merlin_fleet.core.retention import Retention
from merlin_fleet.core.robot_lease import LeaseTimes, RobotLease
from merlin_fleet.core.sharing import OBEYED, TELL, Sharing, Telling
from merlin_fleet.core.store import Compare, Put, Txn, TxnResult, Unwritten
from merlin_fleet.core.view import FleetView

#: Transactions that write keys which robots follow.
FOLLOWED = ("life", "bids", "claim", "report", "missed")
REPLACED = "the hub is another one, or was put back from a backup: what it does not have any more is gone"


class Rules(NamedTuple):
    """Settings of an agent."""

    lease: LeaseTimes = LeaseTimes()
    auction: AuctionTimes = AuctionTimes()
    most_owned: int = 2
    """Goals that it owns at once: one runs, the others wait behind it."""
    most_bids: int = 8
    """Open goals for which it bids at once, in their order."""
    retry: float = 1.0
    """s after which what failed is tried again."""
    ask_again: float = 10.0
    """s after which a cost is asked again: battery, Executor and knowledge may have changed."""
    heard_every: float = 10.0
    """s between its signs of life, from which others know since when it is silent."""
    gather: float = 0.2
    """s for which bids wait for the costs that were asked for, to be written together."""
    gather_changes: float = 0.1
    """s for which changes that are about other robots wait, to be looked at together."""
    facts: Dict[str, str] = {}
    """Predicates that the fleet shares → the robot that writes each."""
    fact_limit: float = 60.0
    """s: a fact that may be older is not planned with in silence."""
    keep: Retention = Retention()
    clean_every: float = 60.0
    """s between two looks at what is no longer kept."""
    clock_margin: float = CLOCK_MARGIN
    """s by which the robot's clock may differ from the hub's, before it leaves deadlines alone."""
    clock_every: float = 30.0
    """s between two questions for the hub's time."""


class Agent:
    """One robot's part.

    :param fleet: name of the fleet.
    :param robot: as it describes itself.
    :param life: a word that no other process uses.
    :param outbox: keeps reports until the store has them.
    :param rules: its times and limits; None: the defaults.
    :param wall_offset: what added to `now` gives s since 1970, by the robot's clock.
    :param fleet_id: of the fleet that the robot was in before; empty: of none.
    """

    def __init__(
        self,
        fleet: str,
        robot: Profile,
        life: str,
        outbox: Outbox,
        rules: Optional[Rules] = None,
        wall_offset: float = 0.0,
        fleet_id: str = "",
    ) -> None:
        records.checked_name(robot.name, "the robot")
        self.keys = Keys(fleet)
        self.robot = robot
        self.life = life
        self.rules = rules = rules or Rules()
        self.wall_offset = wall_offset
        self.fleet_id = fleet_id
        self.now = 0.0
        self.view = FleetView(self.keys, robot)
        self.connected = False
        self.refused = ""
        """Why it does not join this hub."""
        self.denied = ""
        """What the hub forbids to this robot; empty: nothing."""
        self.full = ""
        """Why the hub takes no changes."""
        self.leaving = False
        self.robot_lease = RobotLease(rules.lease)
        self.lag = Lag()
        self.decided: List[ev.Decision] = []
        self._flying: Dict[str, bool] = {}
        self._not_before: Dict[str, float] = {}
        self._asked_lease_at: Optional[float] = None
        self._heard_at: Optional[float] = None
        self._said: Dict[str, bool] = {}
        self.possession = Possession(self)
        self.reporting = Reporting(self, outbox)
        self.bidding = Bidding(self)
        self.sharing = Sharing(self)
        self.cleaning = Cleaning(self)
        self.telling = Telling(self)
        self.clock = ClockCheck(self)

    # --- what the parts use

    @property
    def joined(self) -> bool:
        """Whether the store names this process as the robot, and its lease runs."""
        mine = self.view.lives.get(self.robot.name)
        return (
            self.usable and self.robot_lease.holds(self.now) and mine is not None and mine.life == self.life
        )

    @property
    def usable(self) -> bool:
        """Whether the store is connected, and is that of this robot's fleet."""
        return self.connected and not self.refused and bool(self.view.about)

    @property
    def wall(self) -> float:
        """Wall time, s since 1970."""
        return self.now + self.wall_offset

    def transact(self, tag: str, txn: Txn) -> bool:
        """Sends a transaction; False: the one of this tag is under way, or failed just now."""
        if self.flying(tag) or self.now < self._not_before.get(tag, self.now):
            return False
        self._flying[tag] = True
        self.decided.append(ev.Transact(tag, txn))
        return True

    def flying(self, tag: str) -> bool:
        """Whether a transaction is under way."""
        return tag in self._flying

    def say(self, text: str) -> None:
        """Logs a text, once in the life of the agent."""
        if text not in self._said:
            self._said[text] = True
            self.decided.append(ev.Say(text))

    # --- events

    def handle(self, now: float, event: ev.Event = None) -> List[ev.Decision]:
        """Takes an event; None: time has passed.

        :param now: s, by a clock that never stands still, jumps or is set.
        """
        self.now = max(now, self.now)
        self.decided = []
        self._take(event)
        self._join()
        self.telling.decide()
        self.clock.decide()
        self.possession.decide()
        self.reporting.decide()
        self.sharing.decide()
        self.bidding.decide()
        self.cleaning.decide()
        return self.decided

    def next_moment(self) -> float:
        """When `handle` has to be called at the latest."""
        moments = [self.now + self.rules.lease.renew_every]
        if self.robot_lease.lease and self.robot_lease.stop_at > self.now:
            moments.append(self.robot_lease.stop_at)
        moments += [moment for moment in self._not_before.values() if moment > self.now]
        moments += self.bidding.moments() + self.sharing.moments()
        return min(moments)

    def _take(self, event: ev.Event) -> None:
        if isinstance(event, ev.Connected):
            self._connected(event)
        elif isinstance(event, ev.Resumed):
            self.connected = True
        elif isinstance(event, ev.Changed):
            self.possession.gone(self.view.apply(event.changes))
            self.lag.saw(self.view.revision, self.now)
        elif isinstance(event, ev.Disconnected):
            self.connected = False
        elif isinstance(event, ev.Leased):
            self._leased(event)
        elif isinstance(event, ev.Answered):
            self._answered(event.tag, event.result)
        elif isinstance(event, ev.Refused) and event.tag.startswith(f"{REMOVE} "):
            self.cleaning.refused(event.reason)
        elif isinstance(event, ev.Refused) and event.tag.split(" ")[0] in (TELL, OBEYED):
            self.telling.refused(event.reason)
        elif isinstance(event, ev.Refused):
            self.denied = (
                f"{event.reason}; is it that of the robot '{self.robot.name}', made for the fleet "
                f"{self.keys.root.split('/')[2]!r}?"
            )
            self.say(self.denied)
        elif isinstance(event, ev.Full):
            if not self.full:
                self.decided.append(ev.Say(event.reason))
            self.full = event.reason
        elif isinstance(event, ev.Failed):
            self.say(event.reason)
        elif isinstance(event, ev.Costed):
            self.bidding.costed(event)
        elif isinstance(event, ev.Ended):
            self.possession.ended(event)
        elif isinstance(event, ev.Known):
            self.sharing.known(event)
        elif isinstance(event, ev.Tell):
            self.telling.tell(event)
        elif isinstance(event, ev.Obeyed):
            self.telling.obeyed(event)
        elif isinstance(event, ev.Timed):
            self.clock.timed(event)
        elif isinstance(event, ev.Leaving):
            self.leaving = True

    def _connected(self, event: ev.Connected) -> None:
        view = event.view or FleetView.of(self.keys, event.snapshot, self.robot)
        replaced = event.snapshot.another or not view.follows(self.view)
        self.view = view
        if replaced:
            self.possession.count_anew()
            self.decided.append(ev.Say(REPLACED))
        self.connected, self._heard_at = True, None
        self.possession.read_anew()
        self.telling.read_anew()
        self.lag.forget()
        self.clock.ask_anew()

    def _leased(self, event: ev.Leased) -> None:
        if event.asked != self.robot_lease.lease:
            return  # of a lease that is no longer ours, or a second new one: it ends by itself
        if event.lease:
            self.robot_lease.renew(event.lease, event.asked_at, event.ttl)
        elif event.asked:
            self.robot_lease.lose()
            self._asked_lease_at = None
            self.possession.lost_lease()

    def _answered(self, tag: str, result: Optional[TxnResult]) -> None:
        self._flying.pop(tag, None)
        kind = tag.split(" ")[0]
        if result is not None and result.done:
            self.denied = ""
            self._not_before.pop(tag, None)
            if kind in FOLLOWED:
                self.lag.wrote(result.revision, self.view.revision, self.now)
            if self.full and kind not in (REMOVE, FORGET):  # they only delete
                self.full = ""
                self.decided.append(ev.Say("the hub takes changes again"))
        elif result is not None and kind == "claim":
            # Often another goal of the same part was claimed meanwhile.
            self._not_before[tag] = self.now + self.rules.retry / 10
        else:
            self._not_before[tag] = self.now + self.rules.retry
        if kind == "claim":
            self.possession.claimed(tag, result)
        elif kind == "bids":
            self.bidding.answered(result)
        elif kind in ("report", "late"):
            self.reporting.answered(tag, result)
        elif kind in (REMOVE, FORGET):
            self.cleaning.answered(tag)
        elif kind == TELL:
            self.telling.answered(tag.split(" ")[1], result is not None and result.done)

    # --- joining

    def _join(self) -> None:
        self._not_before = {tag: at for tag, at in self._not_before.items() if at > self.now}
        if not self.connected:
            return
        self._check_hub()
        asked = self._asked_lease_at
        if not self.refused and (asked is None or self.now >= asked + self.rules.lease.renew_every):
            self._asked_lease_at = self.now
            self.decided.append(ev.AskLease(self.robot_lease.lease))
        if not self.usable or not self.robot_lease.holds(self.now):
            return
        self._take_life()
        if self.joined and (self._heard_at is None or self.now >= self._heard_at + self.rules.heard_every):
            self._heard_at = self.now
            profile = self.robot._replace(heard=self.wall)
            key = self.keys.key(records.ROBOTS, self.robot.name)
            self.transact("robot", Txn(puts=(Put(key, records.encode(profile)),)))

    def _check_hub(self) -> None:
        about = self.keys.key(records.ABOUT)
        unreadable = self.view.unreadable.get(about, "")
        if unreadable:
            self.refused = f"the hub is not used: {unreadable}"
        elif self.view.about and self.fleet_id and self.view.about != self.fleet_id:
            self.refused = (
                f"the hub is not used: its fleet is {self.view.about}, this robot is of {self.fleet_id}; "
                "reports wait here for the hub of that fleet"
            )
        else:
            self.refused = ""
            if not self.view.about:
                text = records.encode_about(self.fleet_id or self.life)
                self.transact("about", Txn((Compare(about, 0),), (Put(about, text),)))
            self.fleet_id = self.fleet_id or self.view.about
        if self.refused:
            self.say(self.refused)
            return
        for key, reason in self.view.unreadable.items():
            if key != about:
                self.say(f"{key} is left alone: {reason}")

    def _take_life(self) -> None:
        """Joins as the robot's only process: waits until the lease of an earlier process has ended."""
        name = self.robot.name
        key = self.keys.key(records.LIVES, name)
        seen = self.view.lives.get(name)
        if seen is not None and seen.life != self.life:
            self.say(f"waits: another process is the robot '{name}', or was until its lease ends")
        elif seen is None:
            text = records.encode(Claim(name, self.life))
            self.transact("life", Txn((Compare(key, 0),), (Put(key, text, self.robot_lease.lease),)))

    def mine(self) -> Compare:
        """Holds while this process is the robot's one."""
        life = self.view.lives[self.robot.name]
        return Compare(self.keys.key(records.LIVES, self.robot.name), life.epoch)

    def still_open(self, goal: str) -> Unwritten:
        """Holds while a goal that this robot sees as open was neither claimed nor ended since then."""
        return Unwritten(self.keys.marks(goal), self.possession.known_since(goal))

    def mark(self, goal: str) -> Put:
        """What is written with a claim, and with the end of an open goal: no other robot's holds then."""
        return Put(self.keys.marks(goal) + self.robot.name, self.life)

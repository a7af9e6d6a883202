# SPDX-License-Identifier: Apache-2.0
"""Bids for open goals, and the end of open goals whose deadline has passed."""

from typing import TYPE_CHECKING, Dict, List, Optional, Tuple

from merlin_fleet.core import events as ev
from merlin_fleet.core import records
from merlin_fleet.core.auction import AuctionTimes, lot, order, take_at, unsuited
from merlin_fleet.core.possession import MISSED
from merlin_fleet.core.records import Bid, Bids, Goal, Report
from merlin_fleet.core.store import Compare, Put, Txn, TxnResult
from merlin_fleet.core.view import FleetGoalState

if TYPE_CHECKING:
    from merlin_fleet.core.agent import Agent

FULL = "it has enough to do"
LOTS = 1 << 16  # into so many parts the time over which a crowd bids is divided


class Bidding:
    """Bids for open goals."""

    def __init__(self, agent: "Agent") -> None:
        self._agent = agent
        self._costs: Dict[str, Bid] = {}
        self._costed_at: Dict[str, float] = {}
        self._queue = -1
        self._asked: Optional[str] = None
        self._opened: Dict[str, float] = {}
        self._written: Optional[Bids] = None
        self._written_at = 0.0
        self._written_in: Optional[int] = None  # the revision, when it is known
        self._gathering_since: Optional[float] = None
        self._moments: List[float] = []
        self._overdue = 0
        self._refusals = 0
        self._seen: Tuple[object, ...] = ()
        self._considered: List[Goal] = []
        self._further: List[Goal] = []  # that it has refused, behind those that it considers
        self._further_at = 0.0  # when one of them may be asked for again
        self._first = ("", 0.0)  # the first goal that it could do, and since when it is
        self._lots: Dict[str, int] = {}
        self._times = agent.rules.auction
        self._turn = lot(agent.robot.name, "") % LOTS / LOTS

    def moments(self) -> List[float]:
        """When something has to be decided."""
        return [moment for moment in self._moments if moment > self._agent.now]

    def costed(self, event: ev.Costed) -> None:
        """The cost of a goal is known."""
        self._asked = None
        if event.queue != self._queue:
            return
        before = self._costs.get(event.goal)
        old = "; ".join(self._agent.sharing.stale) if event.cost is not None else ""
        self._costs[event.goal] = bid = Bid(event.cost, records.reason_text(event.reason or old))
        self._costed_at[event.goal] = self._agent.now
        self._refusals += (before is not None and before.cost is None) is not (bid.cost is None)
        if event.cost is None:
            self._agent.possession.give_back(event.goal, bid.reason)

    def answered(self, result: Optional[TxnResult]) -> None:
        """Bids were written, or not."""
        self._written_in = result.revision if result is not None and result.done else None

    def decide(self) -> None:
        """Ends what is overdue, asks for costs, writes bids, takes goals."""
        agent = self._agent
        self._moments, self._times = [], self._timed()
        if not agent.joined or agent.leaving:
            self._opened, self._written = {}, None
            return
        self._end_overdue()
        if self._queue != agent.possession.version:
            self._queue, self._costs, self._costed_at = agent.possession.version, {}, {}
        full = len(agent.possession.owned) >= agent.rules.most_owned  # a claim under way may be lost
        considered = [] if full else self._consider()
        self._opened = {
            goal.id: max(self._opened.get(goal.id, agent.now), agent.possession.free_at(goal.id))
            for goal in considered
        }
        bids = self._bids(considered)
        self._ask([goal for goal in considered if not self._refusal(goal)])
        self._write(Bids({}, FULL) if full else Bids(bids))
        for goal in considered:
            self._take(goal)

    def _consider(self) -> List[Goal]:
        """The goals for which it bids, then the goals that it refuses."""
        view, pool = self._agent.view, self._agent.rules.most_bids
        while pool < self._with_room():
            pool *= 2  # about as many goals as will have an owner soon
        left = self._left()
        counts = (self._overdue, self._queue, self._refusals)
        seen = (id(view), view.version, pool, *counts, left, self._agent.clock.refusal)
        if seen != self._seen:
            self._seen = seen
            owned = self._agent.possession.owned
            self._costs = {
                name: bid
                for name, bid in self._costs.items()
                if name in owned or view.state(name) is FleetGoalState.OPEN
            }
            self._costed_at = {name: self._costed_at[name] for name in self._costs}
            suited, refused = self._choose(pool)
            first = suited[0].id if suited else ""
            if first != self._first[0]:
                self._first, left = (first, self._agent.now), ""
            self._considered = self._keep(suited, self._share(suited, left)) + refused
        return self._considered

    def _keep(self, all_goals: List[Goal], goals: List[Goal]) -> List[Goal]:
        """The first goals; or those of last time, while half of them are open and none is new before them."""
        most = self._agent.rules.most_bids
        kept = [goal for goal in goals if goal.id in self._opened]
        new = next((goal for goal in goals[:most] if goal.id not in self._opened), None)
        if len(all_goals) > most < 2 * len(kept) and (new is None or order(kept[-1]) < order(new)):
            return kept[:most]
        return goals[:most]

    def _choose(self, pool: int) -> Tuple[List[Goal], List[Goal]]:
        agent = self._agent
        view, most = agent.view, agent.rules.most_bids
        suited: List[Goal] = []
        refused: List[Goal] = []
        wrong = bool(agent.clock.refusal)
        for *_, name in view.open:
            goal = view.goals[name]
            timeless = wrong and goal.deadline is not None
            past = goal.deadline is not None and not wrong and goal.deadline <= agent.wall
            if name in agent.possession.owned or past:
                continue
            cost = self._costs.get(name)
            if timeless or (cost is not None and cost.cost is None):
                refused.append(goal)
            else:
                suited.append(goal)
                if len(suited) >= pool:
                    break
        self._further = [goal for goal in refused[most:] if not (wrong and goal.deadline is not None)]
        refused += [view.goals[name] for *_, name in view.unsuited[:most]]
        return suited, refused[:most]

    def _left(self) -> str:
        """The first goal, when the robots in whose share it is do not take it."""
        agent, times = self._agent, self._times
        first, since = self._first
        moment = since + times.window
        if agent.view.offers.offered(first):
            moment += times.enough * times.step
        if agent.now >= moment:
            return first
        self._moments.append(moment)
        return ""

    def _share(self, goals: List[Goal], left: str) -> List[Goal]:
        """Where many robots and many goals are free, a robot bids for some: each goal has some bids.

        A goal for this robot alone is always in its share, and so is the first goal that is left: no goal is
        left forever.
        """
        robot, parts = self._agent.robot.name, 1
        while len(goals) > parts * self._agent.rules.most_bids:
            parts *= 2  # so a share stays what it is, or is halved, when the number of goals changes
        if parts == 1:
            return goals
        lots = self._lots
        self._lots = lots = {
            goal.id: lots[goal.id] if goal.id in lots else lot(goal.id, robot) for goal in goals
        }
        return [goal for goal in goals if lots[goal.id] % parts == 0 or goal.robot or goal.id == left]

    def _with_room(self) -> int:
        view = self._agent.view
        return len(view.lives) - view.offers.closed

    def _bids(self, considered: List[Goal]) -> Dict[str, Bid]:
        bids = {}
        for goal in considered:
            reason = self._refusal(goal)
            bid = Bid(None, reason) if reason else self._costs.get(goal.id)
            if bid is not None and self._useful(goal, bid):
                bids[goal.id] = bid
        return bids

    def _refusal(self, goal: Goal) -> str:
        """Why it does not take a goal, whatever it costs; empty: it may."""
        return unsuited(goal, self._agent.robot) or self._timeless(goal)

    def _timeless(self, goal: Goal) -> str:
        """Why it does not take a goal with a deadline: a wrong clock does not show whether it has passed."""
        return self._agent.clock.refusal if goal.deadline is not None else ""

    def _ask(self, goals: List[Goal]) -> None:
        """Asks for one cost: of a goal that has none, or for the oldest, as much may have changed.

        Also of what it has not begun: a robot that cannot do it any more gives it back.
        """
        agent = self._agent
        if self._asked is not None:
            return
        goals = goals + agent.possession.returnable()
        goal = min(goals, key=lambda each: self._costed_at.get(each.id, -1.0), default=None)
        if goal is None or goal.id in self._costs:
            goal = self._one_further() or goal
        if goal is None or not self._is_old(goal):
            return
        self._asked = goal.id
        behind = tuple(owned for owned in agent.possession.queue() if owned.id != goal.id)
        agent.decided.append(ev.AskCost(goal, behind, self._queue))

    def _is_old(self, goal: Goal) -> bool:
        """Whether the cost of a goal is missing, or was asked for so long ago that it may be another one."""
        if goal.id not in self._costs:
            return True
        moment = self._costed_at[goal.id] + self._agent.rules.ask_again
        self._moments.append(moment)
        return self._agent.now >= moment

    def _one_further(self) -> Optional[Goal]:
        """The further refused goal that was asked for first, one in each `ask_again`; None: not now.

        Else goals that no robot can ever do would keep the robot from the refused ones behind them forever.
        """
        if not self._further:
            return None
        if self._agent.now < self._further_at:
            self._moments.append(self._further_at)
            return None
        goal = min(self._further, key=lambda each: self._costed_at.get(each.id, -1.0))
        if not self._is_old(goal):
            return None
        self._further_at = self._agent.now + self._agent.rules.ask_again
        return goal

    def _useful(self, goal: Goal, bid: Bid) -> bool:
        """Whether a bid is written: in a crowd not all bid, and not at once."""
        agent, times = self._agent, self._times
        if (self._written is not None and goal.id in self._written.of) or self._with_room() <= times.crowd:
            return True
        name, offers = agent.robot.name, agent.view.offers
        if bid.cost is None:
            before = offers.answers(goal.id) - offers.closed
        else:
            before = offers.cheaper(goal.id, name, bid.cost)
        opened = self._opened[goal.id]
        turn = times.spread * self._turn  # so a robot writes at most once in `spread`
        moment = opened + (turn - opened) % times.spread
        if before < times.enough and agent.now < moment:
            self._moments.append(moment)
        return before < times.enough and agent.now >= moment

    def _write(self, bids: Bids) -> None:
        """Writes what is new. Bids for goals that are no longer open do no harm: they go out then."""
        agent, before = self._agent, self._written
        if before is not None and bids.reason == before.reason and bids.of.items() <= before.of.items():
            self._gathering_since = None
            if agent.view.offers.of(agent.robot.name) == before or self._on_their_way():
                return
        elif not bids.reason and (self._is_behind() or self._gathers()):
            return
        key = agent.keys.key(records.BIDS, agent.robot.name)
        put = Put(key, records.encode_bids(bids), agent.robot_lease.lease)
        if agent.transact("bids", Txn((agent.mine(),), (put,))):
            self._written, self._written_at, self._written_in = bids, agent.now, None

    def _on_their_way(self) -> bool:
        """Whether this robot cannot have seen yet what it wrote; an older put that came late is written over.

        Not by time alone where the revision is known: robots that are behind would write again what makes
        all of them come further behind.
        """
        if self._written_in is not None:
            return self._agent.view.revision < self._written_in
        return self._agent.now < self._written_at + 3 * self._agent.rules.retry

    def _is_behind(self) -> bool:
        """Whether it should not bid now: its bids would be late, and put all robots further behind."""
        agent = self._agent
        self._moments.append(agent.lag.until)
        return agent.lag.blind(agent.now) or agent.now < agent.lag.until

    def _timed(self) -> AuctionTimes:
        """Times of an auction; a robot that is behind sees bids and claims later, and waits for them."""
        times, late = self._agent.rules.auction, self._agent.lag.seconds(self._agent.now)
        if not late:
            return times
        return times._replace(
            window=times.window + late, step=times.step + 2 * late, spread=times.spread + 2 * late
        )

    def _gathers(self) -> bool:
        """Whether the costs that were asked for are awaited, to be written together."""
        agent = self._agent
        if self._asked is None:
            self._gathering_since = None
            return False
        if self._gathering_since is None:
            self._gathering_since = agent.now
        moment = self._gathering_since + agent.rules.gather
        self._moments.append(moment)
        return agent.now < moment

    def _take(self, goal: Goal) -> None:
        agent = self._agent
        own = agent.view.offers.of(agent.robot.name)
        if self._timeless(goal) or agent.possession.full():
            return
        if own is None or own.of.get(goal.id) != self._costs.get(goal.id):
            return  # what the others see is not up to date
        opened, joined = self._opened[goal.id], len(agent.view.lives)
        moment = take_at(goal.id, agent.robot.name, agent.view.offers, joined, opened, self._times)
        if moment is None:
            return
        if agent.now >= moment:
            agent.possession.claim(goal)
        else:
            self._moments.append(moment)

    def _end_overdue(self) -> None:
        """Ends open goals whose deadline has passed; the robots have their turns one after the other."""
        agent = self._agent
        robots: List[str] = []
        self._overdue = 0
        if agent.clock.refusal:
            return
        for deadline, name in agent.view.due:
            if deadline > agent.wall:
                self._moments.append(agent.now + deadline - agent.wall)
                return
            self._overdue += 1
            robots = robots or sorted(agent.view.lives)
            turn = (robots.index(agent.robot.name) + lot(name, "")) % len(robots) * agent.rules.retry
            if agent.wall >= deadline + turn:
                self._miss(name)
            else:
                self._moments.append(agent.now + deadline + turn - agent.wall)

    def _miss(self, goal: str) -> None:
        agent, keys = self._agent, self._agent.keys
        end = keys.key(records.ENDS, agent.robot.name, goal)
        report = Report(
            goal, agent.robot.name, 0, MISSED, "its deadline has passed, and no robot has it", agent.wall
        )
        compare = (
            Compare(keys.key(records.GOALS, goal), agent.view.written[goal]),
            Compare(keys.key(records.CANCELS, goal), 0),
            agent.still_open(goal),
        )
        puts = (Put(end, records.encode(report)), agent.mark(goal))
        agent.transact(f"missed {goal}", Txn(compare, puts))

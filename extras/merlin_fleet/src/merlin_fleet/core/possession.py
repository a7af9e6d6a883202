# SPDX-License-Identifier: Apache-2.0
"""The goals that a robot owns: taken, begun, stopped by its own clock, ended, given up."""

from enum import Enum
from typing import TYPE_CHECKING, Dict, List, Optional, Set, Tuple

from merlin_fleet.core import events as ev
from merlin_fleet.core import records
from merlin_fleet.core.auction import order
from merlin_fleet.core.records import Claim, Goal, Report
from merlin_fleet.core.store import Compare, Put, Txn, TxnResult

if TYPE_CHECKING:
    from merlin_fleet.core.agent import Agent

CANCELLED = "CANCELLED"
MISSED = "MISSED"
LEASE_ENDS = "the lease of the fleet ends"  # why what runs is stopped
REMEMBERED = 100  # goals of before: when there are twice as many as needed, those that are gone are forgotten
MOST_TURNS = 4  # after so many lost claims in a row the wait before the next one grows to 16 times


class Phase(Enum):
    """Where an owned goal is."""

    WAITING = "waiting"
    RUNNING = "running"
    STOPPING = "stopping"
    """The lease is about to end; the goal stays ours if it is renewed."""
    CANCELLING = "cancelling"
    LOST = "lost"
    """No longer owned, while its execution here continues."""


class Owned:
    """A goal that this robot owns, at an epoch."""

    def __init__(self, goal: Goal, epoch: int) -> None:
        self.goal = goal
        self.epoch = epoch
        self.phase = Phase.WAITING
        self.begun = False
        """Whether it was in time; what an earlier process of this robot has left counts as begun."""

    @property
    def executing(self) -> bool:
        """Whether something of it may move."""
        return self.phase is not Phase.WAITING


class Possession:
    """The goals that a robot owns."""

    def __init__(self, agent: "Agent") -> None:
        self._agent = agent
        self.owned: Dict[str, Owned] = {}
        self.version = 0
        """Changes with the queue."""
        self._settled: Dict[str, int] = {}
        """Goal → the last epoch of it that is over for this robot."""
        self._most_settled = REMEMBERED
        self._claiming: Set[str] = set()
        """Goals whose claim is under way."""
        self._taken_over: Set[str] = set()
        """Goals of an earlier process of this robot, which may have begun them."""
        self._given_back: Set[str] = set()
        """Goals that it has not begun, and cannot do; until it claims them anew."""
        self._behind = (0, 0.0)
        """Revision of the last claim that was lost, and until when that revision is awaited."""
        self._lost_claims = 0
        """How many claims in a row were lost before this robot saw the other claim."""
        self._free_at: Dict[str, float] = {}
        """Goal whose claim is gone → when its owner stands."""
        self._read = (0, 0.0)
        """The revision at which all keys were read, and when all stand who had lost a goal until then."""

    # --- what the others ask

    def full(self) -> bool:
        """Whether it takes no further goal."""
        return len(self._claiming.union(self.owned)) >= self._agent.rules.most_owned

    def queue(self) -> List[Goal]:
        """The goals that it owns, in the order of execution."""
        return [each.goal for each in sorted(self.owned.values(), key=_running_first)]

    def leased(self) -> Tuple[str, ...]:
        """The goals that run, and that may run no longer than the lease."""
        runs = (owned for owned in self.owned.values() if owned.phase is Phase.RUNNING)
        return tuple(owned.goal.id for owned in runs if not owned.goal.finish)

    def free_at(self, goal: str) -> float:
        """When nothing of a goal moves any more that no robot owns. Only its owner knows it earlier."""
        return self._free_at.get(goal, 0.0)

    def known_since(self, goal: str) -> int:
        """The revision from which on no claim of an open goal is allowed, as this robot does not know it.

        A claim that was gone when the robot read all keys may be one whose owner still moves. The marks show
        whether there was one since the goal was sent.
        """
        agent, (revision, sure_at) = self._agent, self._read
        written = agent.view.written[goal]
        unsure = written <= revision and agent.now < sure_at and goal not in self._free_at
        return written if unsure else agent.view.revision

    def claim(self, goal: Goal) -> None:
        """Takes an open goal, if the store still has it as open when the transaction arrives."""
        agent, keys = self._agent, self._agent.keys
        if agent.lag.blind(agent.now):
            return  # others may have claimed it since then
        revision, until = self._behind
        if agent.view.revision < revision and agent.now < until:
            return  # it would be lost again: this robot has not yet seen the other claim
        if agent.view.revision >= revision:
            self._lost_claims = 0
        claim = records.encode(Claim(agent.robot.name, agent.life, ttl=agent.rules.lease.ttl))
        compare = (
            Compare(keys.key(records.GOALS, goal.id), agent.view.written[goal.id]),
            Compare(keys.key(records.CANCELS, goal.id), 0),
            agent.still_open(goal.id),
            agent.mine(),
        )
        self._taken_over.discard(goal.id)
        self._given_back.discard(goal.id)
        lease = 0 if goal.finish else agent.robot_lease.lease
        put = Put(keys.key(records.CLAIMS, agent.robot.name, goal.id), claim, lease)
        if agent.transact(f"claim {goal.id}", Txn(compare, (put, agent.mark(goal.id)))):
            self._claiming.add(goal.id)

    # --- what has happened

    def claimed(self, tag: str, result: Optional[TxnResult]) -> None:
        """A claim was answered."""
        name = tag.split(" ")[1]
        self._claiming.discard(name)
        if result is not None and not result.done:
            # The revision may be of a key that no robot follows, so it is not awaited forever; and by
            # each turn longer, or robots that are behind would keep the hub and themselves busy with it.
            self._behind = (result.revision, self._agent.now + self._agent.rules.retry * 2**self._lost_claims)
            self._lost_claims = min(self._lost_claims + 1, MOST_TURNS)
            if name in self._agent.view.goals and self.known_since(name) < self._agent.view.revision:
                self._free_at[name] = self._read[1]
        goal = self._agent.view.goals.get(name)
        if goal is not None and result is not None and result.done:
            self._own(goal, result.revision)

    def gone(self, claims: Dict[str, Claim]) -> None:
        """Claims have vanished. Why is not to be seen: what ends a lease may have been anyone's command."""
        agent = self._agent
        for goal, claim in claims.items():
            failed = str(claim.epoch) in agent.view.failures.get(goal, {})
            stands = failed or claim.life in ("", agent.life)
            ttl = 0.0 if stands else max(claim.ttl, agent.rules.lease.ttl)
            self._free_at[goal] = agent.now + agent.rules.lease.wait(ttl)

    def read_anew(self) -> None:
        """All keys were read: claims may have come and gone meanwhile."""
        agent, lease = self._agent, self._agent.rules.lease
        sure_at = max([agent.now + lease.wait(lease.ttl), *self._free_at.values()])
        self._read, self._free_at = (agent.view.revision, sure_at), {}

    def count_anew(self) -> None:
        """The store is another one, or one of before: epochs of until now say nothing of it."""
        agent = self._agent
        for owned in list(self.owned.values()):
            claim = agent.view.claims.get(owned.goal.id)
            mine = claim is not None and claim.life == agent.life
            owned.epoch = claim.epoch if claim is not None and mine else 0
            if not mine:
                self._lose(owned)
        self._settled.clear()
        self._behind, self._lost_claims = (0, 0.0), 0

    def _forget(self) -> None:
        """Forgets goals that the store does not have any more: no answer or change makes them ours again."""
        goals = self._agent.view.goals.keys() | self.owned.keys() | self._claiming
        self._settled = {goal: epoch for goal, epoch in self._settled.items() if goal in goals}
        self._taken_over &= goals
        self._given_back &= goals
        self._most_settled = 2 * len(self._settled) + REMEMBERED

    def _reconcile(self) -> None:
        """Compares what is owned with what the store says of it."""
        view = self._agent.view
        for owned in list(self.owned.values()):
            claim = view.claims.get(owned.goal.id)
            kept = claim is not None and claim.life == self._agent.life and claim.epoch >= owned.epoch
            if view.revision >= owned.epoch and not kept:
                self._lose(owned)
        for goal_id in view.owned_by.get(self._agent.robot.name, ()):
            claim = view.claims[goal_id]
            if claim.life == self._agent.life and goal_id in view.goals:
                self._own(view.goals[goal_id], claim.epoch)

    def _own(self, goal: Goal, epoch: int) -> None:
        owned = self.owned.get(goal.id)
        if epoch <= self._settled.get(goal.id, 0):
            return  # an old answer or change
        if owned is None:
            self.owned[goal.id] = owned = Owned(goal, epoch)
            owned.begun = goal.id in self._taken_over
            self.version += 1
        elif owned.phase is not Phase.LOST:
            owned.epoch = max(owned.epoch, epoch)

    def lost_lease(self) -> None:
        """The store has ended the lease, and the claims with it."""
        for owned in list(self.owned.values()):
            if not owned.goal.finish:
                self._lose(owned)

    def _lose(self, owned: Owned) -> None:
        self._settled[owned.goal.id] = owned.epoch
        if owned.phase is Phase.WAITING:
            self._drop(owned)
        elif owned.phase is not Phase.LOST:
            if owned.phase is Phase.RUNNING:
                self._stop(owned, "the fleet has taken it away")
            owned.phase = Phase.LOST

    def ended(self, event: ev.Ended) -> None:
        """An execution has ended."""
        owned = self.owned.get(event.goal)
        if owned is None or not owned.executing:
            return
        stopped = owned.phase in (Phase.STOPPING, Phase.LOST)
        if stopped and not event.achieved:
            # Only the stop has ended it. What is ours still, or again, waits for its turn.
            if owned.phase is Phase.LOST:
                self._drop(owned)
            else:
                owned.phase = Phase.WAITING
            return
        self._end(owned, event.achieved, event.outcome, event.reason)

    def returnable(self) -> List[Goal]:
        """The goals that it has not begun, and that another robot may do."""
        waiting = (owned for owned in self.owned.values() if owned.phase is Phase.WAITING and not owned.begun)
        return [owned.goal for owned in waiting if not (owned.goal.finish or owned.goal.robot)]

    def give_back(self, goal: str, reason: str) -> None:
        """Gives a goal back that it cannot do at present, unless it is too late for that."""
        if any(each.id == goal for each in self.returnable()):
            self._agent.decided.append(ev.Say(f"it gives {goal} back, which it has not begun: {reason}"))
            self._given_back.add(goal)
            self._drop(self.owned[goal])

    def stopped(self, *goals: str) -> None:
        """Goals that run were stopped at the end of the lease, when this robot was late to decide it."""
        for goal in goals:
            owned = self.owned.get(goal)
            if owned is not None and owned.phase is Phase.RUNNING:
                owned.phase = Phase.STOPPING

    def _end(self, owned: Owned, achieved: bool, outcome: str, reason: str, final: bool = False) -> None:
        agent = self._agent
        reason = records.reason_text(reason)
        report = Report(owned.goal.id, agent.robot.name, owned.epoch, outcome, reason, agent.wall)
        tries = len(agent.view.failures.get(owned.goal.id, {})) + 1
        final = final or achieved or tries >= owned.goal.tries or owned.phase is Phase.CANCELLING
        self._drop(owned)
        agent.reporting.add(report, final)

    def _drop(self, owned: Owned) -> None:
        self._settled[owned.goal.id] = max(owned.epoch, self._settled.get(owned.goal.id, 0))
        self.owned.pop(owned.goal.id, None)
        self.version += 1

    # --- what follows

    def decide(self) -> None:
        """Stops, begins and takes over."""
        agent = self._agent
        self._reconcile()
        if agent.now >= self._read[1]:
            self._free_at = {goal: at for goal, at in self._free_at.items() if at > agent.now}
        if len(self._settled) > self._most_settled:
            self._forget()
        timed = not agent.clock.refusal
        for owned in list(self.owned.values()):
            deadline = owned.goal.deadline
            if owned.goal.id in agent.view.cancels:
                self._cancel(owned)
            elif owned.phase is Phase.RUNNING and not self._may_run(owned):
                self._stop(owned, LEASE_ENDS)
                owned.phase = Phase.STOPPING
            elif owned.phase is Phase.WAITING and agent.leaving:
                self._drop(owned)
            elif timed and not owned.begun and deadline is not None and deadline <= agent.wall:
                self._end(owned, False, MISSED, "its robot did not begin it by its deadline", final=True)
        if agent.leaving:
            for owned in self.owned.values():
                if owned.phase is Phase.RUNNING:
                    self._stop(owned, "the robot leaves the fleet")
                    owned.phase = Phase.LOST
        if agent.usable:
            self._return()
        if agent.leaving:
            return
        self._begin()
        if agent.joined:
            self._take_over()

    def _may_run(self, owned: Owned) -> bool:
        return owned.goal.finish or self._agent.robot_lease.holds(self._agent.now)

    def _begin(self) -> None:
        """Begins the next one when nothing of any other moves any more."""
        if any(owned.executing for owned in self.owned.values()):
            return
        for owned in sorted(self.owned.values(), key=_running_first):
            # Without the changes its claim may be gone, while the lease is renewed.
            if self._may_run(owned) and (owned.goal.finish or self._agent.connected):
                owned.phase, owned.begun = Phase.RUNNING, True
                self._agent.decided.append(ev.Begin(owned.goal))
                return

    def _cancel(self, owned: Owned) -> None:
        if owned.phase is Phase.WAITING:
            owned.phase = Phase.CANCELLING
            self._end(owned, False, CANCELLED, "cancelled before it began")
        elif owned.phase in (Phase.RUNNING, Phase.STOPPING):
            if owned.phase is Phase.RUNNING:
                self._stop(owned, "cancelled in the fleet")
            owned.phase = Phase.CANCELLING

    def _stop(self, owned: Owned, reason: str) -> None:
        self._agent.decided.append(ev.StopExecution(owned.goal.id, reason))

    def to_return(self) -> List[str]:
        """Goals on its lease that it leaves to others, and of which nothing moves any more."""
        agent = self._agent
        view = agent.view
        return [
            goal
            for goal in view.owned_by.get(agent.robot.name, ())
            if view.claims[goal].life == agent.life
            and (agent.leaving or goal in self._given_back)
            and (agent.robot_lease.lease and goal in view.goals and not view.goals[goal].finish)
            and not (goal in self.owned or agent.reporting.knows(goal, view.claims[goal].epoch))
        ]

    def _return(self) -> None:
        """Says that it stands, so that none has to wait; then removes the claims, unless the lease ends."""
        agent, claims = self._agent, self._agent.view.claims
        said = [goal for goal in agent.view.owned_by.get(agent.robot.name, ()) if not claims[goal].life]
        goals = self.to_return() or ([] if agent.leaving else said)
        keys = tuple(agent.keys.key(records.CLAIMS, agent.robot.name, goal) for goal in goals)
        compare = tuple(Compare(key, claims[goal].epoch) for goal, key in zip(goals, keys))
        text = records.encode(Claim(agent.robot.name, ""))
        puts = tuple(Put(key, text, agent.robot_lease.lease) for key in keys)
        if keys:
            agent.transact("return", Txn(compare, (), keys) if goals == said else Txn(compare, puts))

    def _take_over(self) -> None:
        """Goals that an earlier process of this robot has to finish."""
        agent = self._agent
        for goal_id in agent.view.owned_by.get(agent.robot.name, ()):
            claim, goal = agent.view.claims[goal_id], agent.view.goals.get(goal_id)
            if goal is None or not goal.finish or claim.life == agent.life:
                continue
            if agent.reporting.knows(goal_id, claim.epoch):
                continue
            key = agent.keys.key(records.CLAIMS, agent.robot.name, goal_id)
            put = Put(key, records.encode(Claim(agent.robot.name, agent.life, ttl=agent.rules.lease.ttl)))
            if agent.transact(f"claim {goal_id}", Txn((Compare(key, claim.epoch), agent.mine()), (put,))):
                self._claiming.add(goal_id)
                self._taken_over.add(goal_id)


def _running_first(owned: Owned) -> Tuple[bool, float, float, float, str]:
    return (not owned.executing, *order(owned.goal))

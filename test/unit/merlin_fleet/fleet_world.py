# SPDX-License-Identifier: Apache-2.0
"""Robots of a fleet, their links and their hub, small enough to try everything that can happen.

The agents and the keys are the real ones. Time goes in rounds of 1 s by the hub's clock: leases pass, the hub
answers what came, each living robot takes its answers, changes and the ends of its executions, and decides.
What a robot executes outlives its agent by `SILENCE` rounds, as the Executor's lease of its client does.
"""

import pickle
from typing import Dict, Iterator, List, Set, Tuple

from fakes.simulated_store import SimulatedLeaseUnknown, SimulatedStore
from fleet_execution import DEAD, HUNG, TAKES, UP, Execution, Message, Robot

from merlin_fleet.core import events as ev
from merlin_fleet.core import records
from merlin_fleet.core.agent import Rules
from merlin_fleet.core.auction import AuctionTimes
from merlin_fleet.core.records import Goal, Keys
from merlin_fleet.core.retention import Retention
from merlin_fleet.core.robot_lease import LeaseTimes
from merlin_fleet.core.store import Compare, Put, Txn, TxnResult
from merlin_fleet.core.view import FleetView
from merlin_fleet.forgetting import Leavings, leavings

SILENCE = 2  # rounds after which an execution whose agent is silent is cancelled
KEYS = Keys("lab")
TIMES = LeaseTimes(ttl=7.0, renew_every=1.0, stop_time=2.0, drift=0.0)
RULES = Rules(TIMES, AuctionTimes(window=1.0, step=1.0), retry=1.0, ask_again=1e6, heard_every=100.0)
#: Goals are removed soon after their end.
KEEP = RULES._replace(keep=Retention(hours=1.0 / 3600.0, goals=0, grace=1.0), clean_every=1.0)

Event = Tuple[str, ...]


class World:
    """Everything."""

    def __init__(
        self,
        robots: int,
        rules: Rules = RULES,
        rates: Tuple[float, ...] = (),
        finish: bool = False,
        takes: int = TAKES,
    ) -> None:
        self.now = 0.0
        self.store = SimulatedStore()
        self.hub_up = True
        self.hub_tells_time = True
        self.robots = [Robot(index, rules, rates[index] if rates else 1.0) for index in range(robots)]
        self.messages: List[Message] = []
        self.late: List[Message] = []
        self.finish = finish
        self.takes = takes  # rounds of an execution
        self.goals: Dict[str, Goal] = {}
        self.succeeded: List[Tuple[str, str]] = []
        self.ended: Dict[str, List[str]] = {}  # goal → every end that was ever written
        self.cancelled: Set[str] = set()
        self.harm = ""  # what was removed and should not have been
        self.unowned: Dict[str, float] = {}  # goal without a claim → since when

    # --- what clients do

    def send(self, name: str, **more: object) -> None:
        """A client sends a goal."""
        goal = Goal(name, (f"(done {name})",), sent=self.now, finish=self.finish, **more)  # type: ignore[arg-type]
        self.goals[name] = goal
        self._write(KEYS.key(records.GOALS, name), records.encode(goal))

    def cancel(self, name: str) -> None:
        """A client cancels a goal."""
        self.cancelled.add(name)
        self._write(KEYS.key(records.CANCELS, name), "{}")

    def _write(self, key: str, value: str) -> None:
        assert self.store.transact(Txn((Compare(key, 0),), (Put(key, value),))).done

    # --- what may happen

    def events(self) -> Iterator[Event]:
        """Everything that may happen now."""
        for robot in self.robots:
            index = str(robot.index)
            if robot.state == UP:
                yield "hang", index
                yield "kill", index
            else:
                yield "restart", index
                if robot.state == HUNG:
                    yield "resume", index
                # The operator's word: nothing of it moves any more. The command sees to the rest.
                if robot.state == DEAD and not robot.running and self._forgettable(robot):
                    yield "forget", index
            yield ("cut" if robot.linked else "mend"), index
            if robot.agent.robot_lease.lease:
                yield "revoke", index
            if robot.slow:
                yield "quick", index
            elif robot.linked and robot.cursor == len(self.store.changes):
                yield "slow", index
            if robot.rules.ask_again < RULES.ask_again:  # else it does not notice
                yield ("fit" if robot.unfit else "unfit"), index
            # Of a goal to finish it is the operator's word: "forget". Of a claim that is deleted alone, its
            # owner hears by its watch only.
            for goal in () if self.finish or robot.slow else self.goals:
                if self.store.value(KEYS.key(records.CLAIMS, robot.name, goal)):
                    yield "unclaim", index, goal
        yield ("hub down" if self.hub_up else "hub up",)
        for number in range(len(self.messages)):
            yield "lose question", str(number)
            yield "lose answer", str(number)
            yield "delay", str(number)
        if self.late:
            yield ("arrive",)
        for name in self.goals:
            if name not in self.cancelled:
                yield "cancel", name

    def strike(self, event: Event) -> None:
        """Something happens."""
        what, *which = event
        if what == "hub down":
            self.hub_up = False
        elif what == "hub up":
            self.hub_up = True
        elif what == "cancel":
            self.cancel(which[0])
        elif what == "arrive":
            self._answer(self.late.pop(0))
        elif what in ("lose question", "lose answer", "delay"):
            self._lose(what, self.messages.pop(int(which[0])))
        elif what == "revoke":  # by someone else
            self.store.revoke(self.robots[int(which[0])].agent.robot_lease.lease)
        elif what == "unclaim":
            self.store.transact(Txn(deletes=(KEYS.key(records.CLAIMS, f"r{which[0]}", which[1]),)))
        else:
            self._strike_robot(what, self.robots[int(which[0])])

    def _lose(self, what: str, message: Message) -> None:
        if what == "delay":
            self.late.append(message)
        if what == "lose answer" and self.hub_up and self.robots[message.robot].linked:
            self._answer(message, heard=False)
        self._unanswered(message)

    def leavings(self, robot: Robot) -> Leavings:
        """What the lab sees of a robot."""
        return leavings(KEYS, FleetView.of(KEYS, self.store.snapshot()), robot.name)

    def _forgettable(self, robot: Robot) -> bool:
        left = self.leavings(robot)
        return left.known and not left.joined

    def forget(self, robot: Robot) -> None:
        """The lab removes what a robot has left."""
        for txn in self.leavings(robot).removal(KEYS):
            assert self._transact(txn, robot.name).done

    def _strike_robot(self, what: str, robot: Robot) -> None:
        if what == "restart":
            robot.restart()
        elif what == "forget":
            self.forget(robot)
        elif what == "mend":
            robot.linked, robot.heard, robot.slow = True, False, False
        elif what == "cut":
            robot.linked = False
        elif what in ("slow", "quick"):
            robot.slow = what == "slow"
        elif what in ("fit", "unfit"):
            robot.unfit = "its Executor is paused" if what == "unfit" else ""
        else:
            robot.state = {"hang": HUNG, "kill": DEAD, "resume": UP}[what]

    def heal(self) -> None:
        """Everything lives again."""
        self.hub_up = True
        for robot in self.robots:
            robot.linked, robot.heard, robot.slow, robot.unfit = True, False, False, ""
            if robot.state == DEAD:
                robot.restart()
            robot.state = UP

    # --- a round

    def act(self) -> None:
        """The next round."""
        self.now += 1.0
        if self.hub_up:
            self.store.pass_time(1.0)
        messages, self.messages = self.messages, []
        for message in messages:
            if self.hub_up and self.robots[message.robot].linked:
                self._answer(message)
            else:
                self._unanswered(message)
        for robot in self.robots:
            self._execute(robot)
            if robot.state == UP:
                robot.silence = 0
                self._think(robot)
            else:
                robot.silence += 1

    def _answer(self, message: Message, heard: bool = True) -> None:
        decision, event = message.decision, None
        if isinstance(decision, ev.AskLease):
            if decision.lease:
                ttl = self.store.renew(decision.lease)
                event = ev.Leased(decision.lease, message.sent_at, decision.lease if ttl else 0, ttl)
            else:
                kept = self.robots[message.robot].rules.lease.kept
                event = ev.Leased(0, message.sent_at, self.store.grant(kept), kept)
        elif isinstance(decision, ev.Transact):
            try:
                event = ev.Answered(decision.tag, self._transact(decision.txn))
            except SimulatedLeaseUnknown:
                event = ev.Answered(decision.tag, None)
        robot = self.robots[message.robot]
        if heard and robot.linked and message.life == robot.agent.life and message not in self.late:
            robot.inbox.append(event)

    def _transact(self, txn: Txn, forgotten: str = "") -> TxnResult:
        """Has the store do it; notes ends, and what must not be removed.

        :param forgotten: the robot that never comes back: should it, its reports count as late.
        """
        over = {goal for goal in self.goals if self._over(goal)}
        known = len(self.store.changes)
        result = self.store.transact(txn)
        for change in self.store.changes[known:]:
            kind, *names = KEYS.parts(change.key)
            if kind == records.ENDS and change.value is not None:
                self.ended.setdefault(names[1], []).append(change.value)
            elif kind == records.ENDS:
                (robot,) = (each for each in self.robots if each.name == names[0])
                if self.store.value(KEYS.key(records.GOALS, names[1])):
                    self.harm = f"the end of {names[1]} was removed before the goal"
                known_of = all(report.goal != names[1] for report, _ in robot.outbox.reports())
                if not known_of and names[0] != forgotten:
                    self.harm = f"the end of {names[1]} was removed before {robot.name} knew of it"
            elif kind == records.GOALS and names[0] not in over:
                self.harm = f"{names[0]} was removed before its end"
        return result

    def _over(self, goal: str) -> bool:
        """Whether a goal that the store has is over."""
        ends = (self.store.value(KEYS.key(records.ENDS, robot.name, goal)) for robot in self.robots)
        cancelled = self.store.value(KEYS.key(records.CANCELS, goal))
        return not self._owners(goal) and (any(ends) or bool(cancelled))

    def _unanswered(self, message: Message) -> None:
        robot = self.robots[message.robot]
        if isinstance(message.decision, ev.Transact) and message.life == robot.agent.life:
            robot.inbox.append(ev.Answered(message.decision.tag, None))

    def _execute(self, robot: Robot) -> None:
        if robot.silence >= SILENCE or (robot.state == DEAD and robot.silence):
            for execution in robot.running.values():
                execution.stopping = True
        for goal, execution in list(robot.running.items()):
            execution.left -= 1
            execution.stop_takes -= execution.stopping
            if execution.stop_takes <= 0 or execution.left <= 0:
                del robot.running[goal]
                achieved = not execution.stopping
                if achieved:
                    self.succeeded.append((goal, robot.name))
                outcome = "SUCCEEDED" if achieved else "CANCELLED"
                robot.inbox.append(ev.Ended(goal, achieved, outcome))

    def _think(self, robot: Robot) -> None:
        follows = robot.linked and self.hub_up
        if robot.follows is not follows and (robot.heard or not follows):
            robot.inbox.append(ev.Resumed() if follows else ev.Disconnected("cut"))
        robot.follows = follows
        if follows:
            if not robot.heard:
                robot.heard, robot.cursor = True, len(self.store.changes)
                robot.inbox.append(ev.Connected(self.store.snapshot()))
            elif robot.cursor < len(self.store.changes) and not robot.slow:
                changes = tuple(self.store.changes[robot.cursor :])
                robot.cursor = len(self.store.changes)
                robot.inbox.append(ev.Changed(changes))
        inbox, robot.inbox = robot.inbox, []
        robot.agent.wall_offset = robot.ahead
        for event in [*inbox, None]:
            self._carry_out(robot, robot.agent.handle(self.now * robot.rate, event))

    def _carry_out(self, robot: Robot, decisions: List[ev.Decision]) -> None:
        for decision in decisions:
            if isinstance(decision, (ev.AskLease, ev.Transact)):
                sent_at = self.now * robot.rate
                self.messages.append(Message(robot.index, robot.agent.life, sent_at, decision))
            elif isinstance(decision, ev.AskCost):
                why = robot.unfit or ("no plan" if decision.goal.id in robot.never else "")
                cost = None if why else float(1 + robot.index + len(decision.behind) * 2)
                robot.inbox.append(ev.Costed(decision.goal.id, decision.queue, cost, why))
            elif isinstance(decision, ev.AskTime):
                wall = self.now if robot.linked and self.hub_up and self.hub_tells_time else None
                robot.inbox.append(ev.Timed(self.now * robot.rate, wall))
            elif isinstance(decision, ev.Begin):
                before = robot.running.get(decision.goal.id)
                assert before is None or before.stopping, "begun twice"
                robot.running[decision.goal.id] = Execution(self.takes)
            elif isinstance(decision, ev.Obey):
                robot.halts.append(decision.halt.by)
                robot.inbox.append(ev.Obeyed(decision.halt.revision))
            elif isinstance(decision, ev.Learn):
                robot.learned.append(decision)
            elif isinstance(decision, ev.Say):
                robot.said.append((self.now, decision.text))
            elif isinstance(decision, ev.StopExecution) and decision.goal in robot.running:
                robot.running[decision.goal].stopping = True

    # --- what holds

    def wrong(self) -> str:
        """What must never be; empty: nothing of it is."""
        if self.harm:
            return self.harm
        owned = {goal: bool(self._owners(goal)) for goal in self.goals}
        self.unowned = {goal: self.unowned.get(goal, self.now) for goal in self.goals if not owned[goal]}
        executed: Set[str] = set()
        for robot in self.robots:
            for goal in robot.running:
                if goal in executed:
                    return f"{goal} is executed by two robots"
                executed.add(goal)
                owners = self._owners(goal)
                if owners and robot.name not in owners:
                    return f"{goal} is executed by {robot.name} and owned by {owners[0]}"
                if not owners and self.now - self.unowned[goal] >= robot.rules.lease.ttl:
                    return f"{goal} is executed by {robot.name} while any robot may take it"
                if len(owners) > 1:
                    return f"{goal} is owned by {' and '.join(owners)}"
        return ""

    def _owners(self, goal: str) -> List[str]:
        keys = {robot.name: KEYS.key(records.CLAIMS, robot.name, goal) for robot in self.robots}
        return [name for name, key in keys.items() if self.store.value(key)]

    def ends(self, goal: str) -> List[str]:
        """The ends of a goal, also when they were removed since then."""
        return self.ended.get(goal, [])

    def left(self, goal: str) -> List[str]:
        """The keys of a goal that are in the store."""
        marks = (records.TAKEN, records.BIDS)
        keys = (item.key for item in self.store.snapshot().items)
        return [key for key in keys if goal in key.split("/") and KEYS.parts(key)[0] not in marks]

    def settled(self) -> str:
        """What is not as it has to be when all is healed and nothing goes on; empty: all is."""
        for robot in self.robots:
            if robot.running:
                return f"{robot.name} still executes {list(robot.running)}"
            if robot.outbox.reports():
                return f"the outbox of {robot.name} is not empty"
        for goal in self.goals:
            ends = self.ends(goal)
            if self._owners(goal):
                return f"{goal} is still owned"
            if len(ends) > 1:
                return f"{goal} has ended twice"
            if not ends and goal not in self.cancelled:
                return f"{goal} is lost"
            if self.robots[0].rules.keep.grace == KEEP.keep.grace and self.left(goal):
                return f"of {goal} there is still {self.left(goal)}"
            if ends and "SUCCEEDED" in ends[0] and goal not in {done for done, _ in self.succeeded}:
                return f"{goal} was never done"
        return ""

    def settles(self, rounds: int = 70) -> str:
        """What is wrong after everything was healed; empty: nothing."""
        self.heal()
        reason = "it never settles"
        for _ in range(rounds):
            self.act()
            if self.wrong():
                return self.wrong()
            reason = self.settled()
            if not reason:
                return ""
        return reason

    def saved(self) -> bytes:
        """All of it; worlds of which this is equal go on alike."""
        return pickle.dumps(self, pickle.HIGHEST_PROTOCOL)

    @staticmethod
    def restored(saved: bytes) -> "World":
        """An independent copy of a world that was saved."""
        world: World = pickle.loads(saved)
        return world

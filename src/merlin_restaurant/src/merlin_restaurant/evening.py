# SPDX-License-Identifier: Apache-2.0
"""The mission: the three stages of the challenge, and guests who call."""

from collections import Counter
from typing import Any, Callable, Dict, List, Optional, Sequence, Union

from merlin_actions.robot_places import RobotPlaces
from merlin_executor.mission import NOTHING, RESEND, GoalState, MissionSM
from merlin_restaurant.menu import CALL, table_called
from merlin_restaurant.table_state import remember_state
from merlin_restaurant.until_known import UntilKnown
from merlin_restaurant.waiting_clients import add_client
from merlin_sm.merlin_sm import MerlinSM
from merlin_sm.state_factory import MerlinStateFactory
from merlin_sm.states.function_state import FunctionState
from merlin_sm.states.merlin_state import ABORTED, PREEMPTED, SUCCEEDED
from merlin_sm.states.speech import ListenState
from merlin_sm.states.while_state import WhileSM

#: Priority of what a guest waits for; it interrupts the round of the tables, which continues afterwards.
URGENT = 10
#: Priority of what guests wait for with several robots; a robot that guides a client finishes that first.
AT_ONCE = 11
LOOKS = 3  # at tables or the entrance, by each of several robots that has no guest while others have
TRIES = 2  # of several robots, to serve a guest in one round: what one fails at ends the plan of all
BAR = "bar"  # all of its counters
ENTRANCE = "(entrance_checked)"
CLOSING_ROUNDS = 3  # at most, when a table could not be looked at after the restaurant had closed
REST = 5.0  # s of running time after a round of several robots in which nothing could be looked at
LISTEN = 30.0  # s of ROS time after which the robot begins to listen anew


class Evening(MissionSM):
    """Rounds of the three stages until the restaurant has closed, while the robot listens for calls.

    :param closed: returns True when the restaurant has closed.
    :param log: called with a line about what the mission decides and why.
    :param on_lost: END or RESEND, what happens to goals during which the Executor is lost.
    :param name: of the mission; the class name when empty.
    :param robots: names of several robots; all that waits is then served by one plan for all of them.
    """

    def __init__(
        self,
        closed: Callable[[], bool],
        log: Callable[[str], None],
        on_lost: str = RESEND,
        name: str = "",
        robots: Sequence[str] = (),
    ) -> None:
        self._robots = list(robots)
        self._closed = closed
        self._narrate = log
        self._table = ""
        self._last_round = False
        self._closing_rounds = 0
        self._tried: Counter[str] = Counter()
        self._asked: List[str] = []  # the goals of guests that several robots serve now
        self._waits: List[UntilKnown] = []
        self._places = RobotPlaces()
        super().__init__(name, on_lost)

    def build(self) -> None:
        """ROUNDS and CALLS at the same time; the end of the rounds is the end of the evening."""
        both = MerlinStateFactory.create("while", self._rounds(), self._calls())
        self.add("EVENING", both, {"seen": ABORTED})

    def _rounds(self) -> MerlinSM:
        """Stage 1: check the tables. Stage 2: serve. Stage 3: look for new clients and guide them."""
        rounds = MerlinSM([SUCCEEDED, ABORTED, PREEMPTED])
        with rounds:
            rounds.add("BEGIN", FunctionState(self._begin_round), {SUCCEEDED: "CHECK_TABLES"})
            follows = "LOOK" if self._robots else "SERVE"
            self.add_goal_state("CHECK_TABLES", self._tables, then(follows, NOTHING))
            if not self._robots:
                serve = {**then("SERVE"), NOTHING: "TIDY"}
                self.add_goal_state("SERVE", self._to_serve, serve, priority=URGENT)
                self.add_goal_state("TIDY", self._to_bring_back, then("LOOK", NOTHING), priority=URGENT)
            self.add_goal_state("LOOK", lambda _: self._entrance(), then("GUIDE", NOTHING))
            if self._robots:  # the other branch serves and guides
                rounds.add("GUIDE", self._until(self._all_served), then("END"))
            else:
                self.add_goal_state("GUIDE", self._to_guide, then("END", NOTHING), priority=URGENT)
            rounds.add("END", FunctionState(self._end_round, outcomes=["open"]), {"open": "REST"})
            rest = UntilKnown(lambda: bool(self.facts("checked")) or not self._robots, REST)
            rounds.add("REST", rest, then("BEGIN"))
        return rounds

    def _calls(self) -> Union[MerlinSM, WhileSM]:
        """A call from a table or from the entrance becomes an urgent goal."""
        calls = MerlinSM([SUCCEEDED, ABORTED, PREEMPTED])
        if self._robots:  # they listen all the time; what is called for is known then
            with calls:
                self._listen(calls, then("LISTEN", "entrance", "no_call"))
            return WhileSM(calls, self._serving())
        with calls:
            meant = {SUCCEEDED: "SERVE", "entrance": "LOOK", "no_call": "LISTEN", ABORTED: "LISTEN"}
            self._listen(calls, meant)
            self.add_goal_state("SERVE", self._called, then("TIDY", NOTHING), priority=URGENT)
            self.add_goal_state("TIDY", self._to_bring_back, then("LISTEN", NOTHING), priority=URGENT)
            look = {SUCCEEDED: "GUIDE", ABORTED: "LISTEN"}
            self.add_goal_state("LOOK", ENTRANCE, look, priority=URGENT)
            self.add_goal_state("GUIDE", self._to_guide, then("LISTEN", NOTHING), priority=URGENT)
        return calls

    def _listen(self, machine: MerlinSM, meant: Dict[str, str]) -> None:
        """Adds LISTEN and NOTE; `meant` says which state follows what a call means."""
        listen = ListenState(CALL, LISTEN, "calls/listen")
        machine.add("LISTEN", listen, {SUCCEEDED: "NOTE", "misunderstood": "LISTEN", ABORTED: "LISTEN"})
        note = FunctionState(self._note_call, ["heard"], outcomes=["entrance", "no_call"])
        machine.add("NOTE", note, meant)

    def _serving(self) -> MerlinSM:
        """Several robots serve all that waits by one plan, which is made anew when more is known to wait."""
        serving = MerlinSM([SUCCEEDED, ABORTED, PREEMPTED])
        with serving:
            serving.add("WAIT", self._until(self._is_new), {SUCCEEDED: "SERVE", ABORTED: "WAIT"})
            serve = GoalState(self._all_that_waits, client=self.client, pause=self._pause, priority=AT_ONCE)
            planned = self._serve = WhileSM(serve, self._until(self._is_new), seen="news")
            serving.add("SERVE", planned, {**then("DONE", NOTHING), "news": "SERVE"})
            serving.add("DONE", FunctionState(self._note_end), then("WAIT"))
        return serving

    def _until(self, condition: Callable[[], bool]) -> UntilKnown:
        self._waits.append(UntilKnown(condition))
        return self._waits[-1]

    def _wake(self) -> None:
        """For what is not a change of the knowledge."""
        for state in self._waits:
            state.wake()

    def _begin_round(self, userdata: Any) -> None:
        """Looks at nothing as checked, and notes whether this is the last round."""
        self._last_round = self._closed()
        self._tried.clear()
        self._narrate(
            "closed: looks once more at what is not ready" if self._last_round else "checks all tables"
        )
        self.remove_facts([*self.facts("checked"), ENTRANCE])

    def _tables(self, userdata: Any) -> List[str]:
        """All tables; in the last round those that are not known to be ready.

        Several robots look at the entrance by the same plan.
        """
        known = named_in(self.facts("ready")) if self._last_round else []
        kept = self._kept()
        tables = [f"(checked {table})" for table in self.objects("table") if table not in [*known, *kept]]
        return [*tables, *self._entrance()] if self._robots and tables else tables

    def _entrance(self) -> List[str]:
        looked = bool(self._robots) and self.holds(ENTRANCE)
        return [] if looked or "entrance" in self._kept() else [ENTRANCE]

    def _kept(self) -> List[str]:
        """Places where a robot stands that takes no actions: no other one can go there."""
        gone = [robot for robot in self._robots if not self.holds(f"(available {robot})")]
        if not gone:
            return []
        known = [fact.strip("()").split()[2] for fact in self.facts("robot_at") if self.out_of_reach(fact)]
        return [*known, *(point for robot in gone for point in self._places.points_at(robot))]

    def _blocked(self, kept: Sequence[str]) -> List[str]:
        """The kept places at which no action is possible; the bar when all of its counters are kept."""
        counters = self.objects("counter") if kept else []
        left = [counter for counter in counters if counter not in kept]
        return [place for place in kept if place not in counters] + [BAR] * (not left and bool(counters))

    def _to_serve(self, userdata: Any) -> List[str]:
        """The next table that needs serving, each once in a round."""
        next_ones = self._waiting_tables()[:1]
        self._tried.update(next_ones)
        return [f"(already_served {table})" for table in next_ones]

    def _waiting_tables(self) -> List[str]:
        """The tables that need serving, without those that were tried often enough in this round."""
        tries, kept = TRIES if self._robots else 1, self._kept()
        tables = [table for table in named_in(self.facts("needs_serving")) if table not in kept]
        return [table for table in tables if self._tried[table] < tries]

    def _urgent(self) -> List[str]:
        """What waits for several robots, each a chain of actions for one of them.

        Clients for whom a table is ready, tables that need serving, and orders whose guests have left.
        """
        kept = self._kept()
        ready = [table for table in named_in(self.facts("ready")) if table not in kept]
        known = named_in(self.facts("waiting"))
        seated = [f"(seated {client})" for client in known[: len(ready)] if self._tried[client] < TRIES]
        tables = self._waiting_tables() if BAR not in self._blocked(kept) else []
        carried = [fact.strip("()").split()[1:] for fact in self._carried()]
        back = [robot for robot, table in carried if table not in tables and self._tried[robot] < TRIES]
        back = back if BAR not in self._blocked(kept) else []
        return [
            *seated,
            *(f"(already_served {table})" for table in tables),
            *(f"(tray_free {robot})" for robot in dict.fromkeys(back)),
        ]

    def _present(self) -> List[str]:
        return [robot for robot in self._robots if self.holds(f"(available {robot})")]

    def _all_served(self) -> bool:
        """Whether no waiting guest can be served now."""
        return not self._urgent() or not self._present()

    def _is_new(self) -> bool:
        """Whether a robot without a guest could serve more that waits, and no conversation is under way."""
        urgent, present = self._urgent(), self._present()
        under_way = [goal for goal in self._asked if goal in urgent]
        return (
            len(under_way) < min(len(urgent), len(present))
            and all(self.holds(f"(quiet {robot})") for robot in present)
            and not self._greeted()
        )

    def _greeted(self) -> bool:
        """Whether a client was greeted and is led next: that is one conversation."""
        greeted = [fact.strip("()").split()[2] for fact in self.facts("greeted")]
        waiting = [client for client in named_in(self.facts("waiting")) if client in greeted]
        return any(f"(seated {client})" in self._asked for client in waiting)

    def _all_that_waits(self, userdata: Any) -> List[str]:
        """What several robots do: serve each guest that waits, and meanwhile a part of the round.

        Only robots that have no guest look around, and not at more than what a guest takes: what is in the
        plan is done in any order, and guests come first.
        """
        self._asked = self._urgent()
        spare = max(0, len(self._present()) - len(self._asked))
        looks = dict.fromkeys([*self._tables(userdata), *self._entrance()])
        left = [goal for goal in looks if goal not in self._asked and not self.holds(goal)]
        return [*self._asked, *self._out_of_the_way(), *left[: spare * LOOKS]]

    def _out_of_the_way(self) -> List[str]:
        """Robots that were stopped between two places go to one: they would stand in the way of guests."""
        goals = [f"(in_position {robot})" for robot in self._present()]
        return [goal for goal in goals if self._tried[goal] < TRIES and not self.holds(goal)]

    def _note_end(self, userdata: Any) -> None:
        """Counts an ended plan as one try for its guests that still wait, or for those at whom it failed."""
        asked, self._asked = self._asked, []
        left = named_in([goal for goal in asked if goal in self._urgent()])
        failed_at = [name for name in left if name in self._serve.reason]
        self._tried.update(failed_at or left)
        moved = [goal for goal in self._out_of_the_way() if goal.split()[1].strip(")") in self._serve.reason]
        self._tried.update(moved)
        self._wake()

    def _carried(self) -> List[str]:
        return [fact for fact in self.facts("carrying") if not self.out_of_reach(fact)]

    def _to_bring_back(self, userdata: Any) -> List[str]:
        """What is still on the tray: its guests have left."""
        return ["(tray_free)"] if self._carried() else []

    def out_of_reach(self, fact: str) -> bool:
        """Whether a fact is about a robot that takes no actions: nothing can be done about it."""
        names = fact.strip("()").split()[1:]
        return any(name in self._robots and not self.holds(f"(available {name})") for name in names)

    def _to_guide(self, userdata: Any) -> List[str]:
        """A client who waits, if there is a free table."""
        clients = named_in(self.facts("waiting"))
        if clients and not self.facts("ready"):
            self._narrate(f"{clients[0]} has to wait: no table is known to be free")
            return []
        return [f"(seated {client})" for client in clients[:1]]

    def _note_call(self, userdata: Any) -> Optional[str]:
        """What a call means: a table needs serving, or a client is at the entrance."""
        if not self._robots and not self.holds("(quiet)"):
            self._narrate("takes that for a part of the conversation that it is in")
            return "no_call"
        table = self._table = table_called(userdata.heard)
        if not table:
            self._narrate("a client at the entrance calls")
            if self._robots:
                if not self.facts("waiting"):  # a second client calls again when the first one is led
                    add_client(self)
            else:
                self.remove_facts(ENTRANCE)
            return "entrance"
        self._narrate(f"{table} calls")
        self._tried.pop(table, None)
        if not self.holds(f"(ordered {table})"):
            remember_state(self, table, "needs_serving")
        self._wake()
        return None

    def _called(self, userdata: Any) -> List[str]:
        return [f"(already_served {self._table})"]

    def _end_round(self, userdata: Any) -> Optional[str]:
        """The evening ends after a round that began when the restaurant had closed, and that saw all."""
        if self._robots and self.facts("waiting") and not self.facts("ready"):
            self._narrate("a client has to wait: no table is known to be free")
        if not self._last_round:
            return "open"
        unseen = [goal for goal in self._tables(userdata) if not self.holds(goal)]
        self._closing_rounds += 1
        if not unseen or self._closing_rounds >= CLOSING_ROUNDS:
            return None
        self._narrate(f"looks again, because not all is known: {' '.join(unseen)}")
        return "open"


def then(label: str, *further: str) -> Dict[str, str]:
    """The mission continues with this state, however the last one ended.

    :param further: outcomes of that state besides succeeded and aborted.
    """
    return dict.fromkeys((SUCCEEDED, ABORTED, *further), label)


def named_in(facts: Sequence[str]) -> List[str]:
    """``(needs_serving table_4)`` → ``table_4``."""
    return [fact.strip("()").split()[1] for fact in facts]

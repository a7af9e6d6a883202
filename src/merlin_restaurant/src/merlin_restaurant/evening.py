"""The mission: the three stages of the challenge, and guests who call."""

from typing import Any, Callable, Dict, List, Optional, Sequence

from merlin_executor.mission import NOTHING, RESEND, MissionSM
from merlin_restaurant.menu import CALL, table_called
from merlin_restaurant.table_state import remember_state
from merlin_sm.merlin_sm import MerlinSM
from merlin_sm.state_factory import MerlinStateFactory
from merlin_sm.states.function_state import FunctionState
from merlin_sm.states.merlin_state import ABORTED, PREEMPTED, SUCCEEDED
from merlin_sm.states.speech import ListenState

URGENT = 10
"""Priority of what a guest waits for; it interrupts the round of the tables, which goes on afterwards."""
CLOSING_ROUNDS = 3  # at most, when a table could not be looked at after the restaurant had closed
LISTEN = 30.0  # s of ROS time after which the robot begins to listen anew


class Evening(MissionSM):
    """Rounds of the three stages until the restaurant has closed, while the robot listens for calls.

    :param closed: returns True when the restaurant has closed.
    :param log: called with a line about what the mission decides and why.
    :param on_lost: END or RESEND, what happens to goals during which the Executor is lost.
    :param name: of the mission; the class name when empty.
    """

    def __init__(
        self,
        closed: Callable[[], bool],
        log: Callable[[str], None],
        on_lost: str = RESEND,
        name: str = "",
    ) -> None:
        self._closed = closed
        self._narrate = log
        self._table = ""
        self._last_round = False
        self._closing_rounds = 0
        self._tried: List[str] = []
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
            self.add_goal_state("CHECK_TABLES", self._tables, then("SERVE"))
            self.add_goal_state("SERVE", self._to_serve, {**then("SERVE"), NOTHING: "TIDY"}, priority=URGENT)
            self.add_goal_state("TIDY", self._to_bring_back, then("LOOK"), priority=URGENT)
            self.add_goal_state("LOOK", "(entrance_checked)", {SUCCEEDED: "GUIDE", ABORTED: "GUIDE"})
            self.add_goal_state("GUIDE", self._to_guide, then("END"), priority=URGENT)
            rounds.add("END", FunctionState(self._end_round, outcomes=["open"]), {"open": "BEGIN"})
        return rounds

    def _calls(self) -> MerlinSM:
        """A call from a table or from the entrance becomes an urgent goal."""
        calls = MerlinSM([SUCCEEDED, ABORTED, PREEMPTED])
        with calls:
            listen = ListenState(CALL, LISTEN, "calls/listen")
            calls.add("LISTEN", listen, {SUCCEEDED: "NOTE", "misunderstood": "LISTEN", ABORTED: "LISTEN"})
            note = FunctionState(self._note_call, ["heard"], outcomes=["entrance", "no_call"])
            meant = {SUCCEEDED: "SERVE", "entrance": "LOOK", "no_call": "LISTEN", ABORTED: "LISTEN"}
            calls.add("NOTE", note, meant)
            self.add_goal_state("SERVE", self._called, then("TIDY"), priority=URGENT)
            self.add_goal_state("TIDY", self._to_bring_back, then("LISTEN"), priority=URGENT)
            look = {SUCCEEDED: "GUIDE", ABORTED: "LISTEN"}
            self.add_goal_state("LOOK", "(entrance_checked)", look, priority=URGENT)
            self.add_goal_state("GUIDE", self._to_guide, then("LISTEN"), priority=URGENT)
        return calls

    def _begin_round(self, userdata: Any) -> None:
        """Looks at nothing as checked, and notes whether this is the last round."""
        self._last_round = self._closed()
        self._tried = []
        self._narrate(
            "closed: looks once more at what is not ready" if self._last_round else "checks all tables"
        )
        self.remove_facts([*self.facts("checked"), "(entrance_checked)"])

    def _tables(self, userdata: Any) -> List[str]:
        """All tables; in the last round those that are not known to be ready."""
        known = named_in(self.facts("ready")) if self._last_round else []
        return [f"(checked {table})" for table in self.objects("table") if table not in known]

    def _to_serve(self, userdata: Any) -> List[str]:
        """The next table that needs serving, each once in a round."""
        waiting = [table for table in named_in(self.facts("needs_serving")) if table not in self._tried]
        self._tried += waiting[:1]
        return [f"(already_served {table})" for table in waiting[:1]]

    def _to_bring_back(self, userdata: Any) -> List[str]:
        """What is still on the tray: its guests have left."""
        return ["(tray_free)"] if self.facts("carrying") else []

    def _to_guide(self, userdata: Any) -> List[str]:
        """A client who waits, if there is a free table."""
        clients = named_in(self.facts("waiting"))
        if clients and not self.facts("ready"):
            self._narrate(f"{clients[0]} has to wait: no table is known to be free")
            return []
        return [f"(seated {client})" for client in clients[:1]]

    def _note_call(self, userdata: Any) -> Optional[str]:
        """What a call means: a table needs serving, or a client is at the entrance."""
        if not self.holds("(quiet)"):
            self._narrate("takes that for a part of the conversation that it is in")
            return "no_call"
        table = self._table = table_called(userdata.heard)
        if not table:
            self._narrate("a client at the entrance calls")
            self.remove_facts("(entrance_checked)")
            return "entrance"
        self._narrate(f"{table} calls")
        if not self.holds(f"(ordered {table})"):
            remember_state(self, table, "needs_serving")
        return None

    def _called(self, userdata: Any) -> List[str]:
        return [f"(already_served {self._table})"]

    def _end_round(self, userdata: Any) -> Optional[str]:
        """The evening ends after a round that began when the restaurant had closed, and that saw all."""
        if not self._last_round:
            return "open"
        unseen = [goal for goal in self._tables(userdata) if not self.holds(goal)]
        self._closing_rounds += 1
        if not unseen or self._closing_rounds >= CLOSING_ROUNDS:
            return None
        self._narrate(f"looks again, because not all is known: {' '.join(unseen)}")
        return "open"


def then(label: str) -> Dict[str, str]:
    """However goals end, the mission goes on with this state."""
    return {SUCCEEDED: label, ABORTED: label, NOTHING: label}


def named_in(facts: Sequence[str]) -> List[str]:
    """``(needs_serving table_4)`` → ``table_4``."""
    return [fact.strip("()").split()[1] for fact in facts]

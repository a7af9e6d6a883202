# SPDX-License-Identifier: Apache-2.0
"""What a robot says: facts of the predicates that it writes, what it does, and that it has obeyed a stop."""

from typing import TYPE_CHECKING, Dict, List, Optional, Tuple

from merlin_fleet.core import events as ev
from merlin_fleet.core import records
from merlin_fleet.core.records import LONGEST_RECORD, Facts, Status
from merlin_fleet.core.store import Compare, Put, Txn

if TYPE_CHECKING:
    from merlin_fleet.core.agent import Agent

MOST_FACTS = 2000  # of a predicate: etcd takes at most 1.5 MB
TELL, OBEYED = "tell", "obeyed"
GRACE = 5.0  # s for the first contact with the hub and the writer


class Sharing:
    """Writes the predicates of this robot; reports what others write, and when it is older than allowed.

    A writer vouches for its facts by its life: as long as the store has that life, its lease runs, and the
    facts are those of its knowledge base. So no key is written only to say that nothing has changed.
    """

    def __init__(self, agent: "Agent") -> None:
        self._agent = agent
        self._own: Dict[str, Facts] = {}
        self._written: Dict[str, Tuple[Facts, float]] = {}
        self._reported: Dict[str, Tuple[str, ...]] = {}
        self._heard: Dict[str, float] = {}
        self._began: Optional[float] = None
        self._stale: Dict[str, str] = {}

    @property
    def stale(self) -> Tuple[str, ...]:
        """What is older than allowed, in words."""
        return tuple(self._stale.values())

    def moments(self) -> List[float]:
        """When a predicate becomes too old."""
        agent = self._agent
        followed = (name for name, writer in agent.rules.facts.items() if writer != agent.robot.name)
        return [moment for moment in map(self._due, followed) if moment > agent.now]

    def _due(self, predicate: str) -> float:
        """When a predicate may be older than allowed: the store keeps a life for a lease after its end."""
        rules, heard = self._agent.rules, self._heard.get(predicate)
        if heard is None:
            return (self._began or 0.0) + min(GRACE, rules.fact_limit)
        return heard + max(0.0, rules.fact_limit - rules.lease.kept)

    def known(self, event: ev.Known) -> None:
        """The robot's knowledge base has these facts."""
        agent, before = self._agent, self._own.get(event.predicate)
        facts = event.facts
        if facts is not None and len(facts) > MOST_FACTS:
            agent.say(f"{event.predicate} is not shared: it has more than {MOST_FACTS} facts")
            facts = None
        if facts is not None:
            now = Facts(agent.robot.name, event.predicate, facts, event.version, agent.life)
        elif before is not None:
            now = before._replace(life="")
        else:
            return
        self._own[event.predicate] = now

    def decide(self) -> None:
        """Writes new facts of this robot; reports new facts of other robots, and facts that are too old."""
        agent = self._agent
        if self._began is None:
            self._began = agent.now
        if agent.joined and not agent.leaving:
            for facts in self._own.values():
                self._write(facts)
        for predicate, writer in agent.rules.facts.items():
            if writer != agent.robot.name:
                self._follow(predicate, writer)

    def _write(self, facts: Facts) -> None:
        agent = self._agent
        if agent.view.facts.get((facts.robot, facts.predicate)) == facts:
            return
        written, at = self._written.get(facts.predicate, (None, 0.0))
        if written == facts and agent.now < at + 3 * agent.rules.retry:
            return  # its change is on its way; an older put that came late is written over
        key = agent.keys.key(records.FACTS, facts.robot, facts.predicate)
        if agent.transact(
            f"facts {facts.predicate}", Txn((agent.mine(),), (Put(key, records.encode(facts)),))
        ):
            self._written[facts.predicate] = (facts, agent.now)

    def _follow(self, predicate: str, writer: str) -> None:
        agent = self._agent
        facts = agent.view.facts.get((writer, predicate)) if agent.usable else None
        if facts is not None:
            if self._reported.get(predicate) != facts.facts:
                self._reported[predicate] = facts.facts
                agent.decided.append(ev.Learn(predicate, facts.facts))
            life = agent.view.lives.get(writer)
            vouched = life is not None and life.life == facts.life
            if vouched and agent.robot_lease.lease:  # since then the store may be out of reach
                self._heard[predicate] = agent.robot_lease.renewed_at
        before = predicate in self._stale
        if agent.now < self._due(predicate):
            self._stale.pop(predicate, None)
            if before:
                agent.decided.append(ev.Say(f"'{predicate}' of {writer} is received again"))
        elif not before:
            limit = agent.rules.fact_limit
            self._stale[predicate] = text = f"'{predicate}' of {writer} may be older than {limit:g} s"
            agent.decided.append(ev.Say(f"it plans with old facts: {text}"))


class Telling:
    """Writes the last record of each kind; passes on a stop, and removes it when it was carried out.

    A stop needs no lease and no life: whatever process is the robot, it stops.
    """

    def __init__(self, agent: "Agent") -> None:
        self._agent = agent
        self._said: Dict[str, str] = {}
        self._sent: Dict[str, str] = {}
        self._written: Dict[str, str] = {}
        self._asked = 0
        """Revision of the last stop that was passed on."""
        self._obeyed = 0
        """Revision of the last one that was carried out."""

    def tell(self, event: ev.Tell) -> None:
        """The robot says something of itself. Only a stop of this store has a revision that clients know."""
        record = event.record
        if isinstance(record, Status) and record.stop != self._asked:
            record = record._replace(stop=0)
        text = records.encode(record)
        if len(text) > LONGEST_RECORD:
            self._agent.say(
                f"the fleet does not get the {event.kind} of this robot: {len(text)} characters are more "
                f"than {LONGEST_RECORD}"
            )
            return
        self._said[event.kind] = text

    def obeyed(self, event: ev.Obeyed) -> None:
        """A stop was carried out; one before the last, or of another store, says nothing of the last."""
        if event.revision == self._asked:
            self._obeyed = event.revision

    def read_anew(self) -> None:
        """All keys were read: another store may have none of this."""
        self._written, self._asked, self._obeyed = {}, 0, 0
        if records.STATUS in self._said:
            said = records.decode(Status, self._said[records.STATUS])
            self.tell(ev.Tell(records.STATUS, said))

    def refused(self, reason: str) -> None:
        """The hub does not allow it: its rights are those of an older version."""
        self._agent.say(f"the fleet does not get what this robot says of itself: {reason}; run `keys allow`")

    def answered(self, kind: str, done: bool) -> None:
        """A transaction that writes a record of a kind has ended."""
        if done:
            self._written[kind] = self._sent[kind]

    def decide(self) -> None:
        """Passes on a stop; writes what is new."""
        agent = self._agent
        if not agent.usable:
            return
        name = agent.robot.name
        life = agent.view.lives.get(name)
        if life is None or life.life != agent.life:
            self._written.clear()  # before it joins again, it may have been forgotten
        halt = agent.view.halts.get(name)
        if halt is not None and halt.revision == self._obeyed:
            key = agent.keys.key(records.HALTS, name)
            agent.transact(OBEYED, Txn((Compare(key, halt.revision),), (), (key,)))
        elif halt is not None and halt.revision != self._asked:
            self._asked = halt.revision
            agent.decided.append(ev.Obey(halt))
        for kind, text in self._said.items() if agent.joined else ():
            if text != self._written.get(kind):
                put = Put(agent.keys.key(kind, name), text)
                if agent.transact(f"{TELL} {kind}", Txn((agent.mine(),), (put,))):
                    self._sent[kind] = text

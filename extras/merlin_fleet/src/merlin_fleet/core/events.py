# SPDX-License-Identifier: Apache-2.0
"""What happens to an agent, and what it decides."""

from typing import NamedTuple, Optional, Tuple, Union

from merlin_fleet.core.records import Goal, Halt, Schema, Status
from merlin_fleet.core.store import Change, Snapshot, Txn, TxnResult
from merlin_fleet.core.view import FleetView

# --- events -----------------------------------------------------------------------------------------


class Connected(NamedTuple):
    """The store was read; from now on its changes come."""

    snapshot: Snapshot
    view: Optional[FleetView] = None
    """What the robot sees; None: the agent reads it from the snapshot, which takes long with many keys."""


class Resumed(NamedTuple):
    """Changes come again; the next one follows the last one delivered."""


class Changed(NamedTuple):
    """Keys of the store have changed."""

    changes: Tuple[Change, ...]


class Disconnected(NamedTuple):
    """No changes come any more."""

    reason: str


class Leased(NamedTuple):
    """The store's answer to AskLease."""

    asked: int
    """The lease of the question; 0: for a new one."""
    asked_at: float
    lease: int
    """0: the store no longer knows that lease."""
    ttl: float


class Answered(NamedTuple):
    """The end of a transaction."""

    tag: str
    result: Optional[TxnResult]
    """None: no answer came; it may have been done, or may still be done."""


class Refused(NamedTuple):
    """The store does not allow it."""

    reason: str
    tag: str = ""
    """Tag of the transaction that was refused."""


class Full(NamedTuple):
    """The store takes no changes at present. Leases are renewed, and keys removed."""

    reason: str


class Failed(NamedTuple):
    """The store is there, and does not do what was asked; it is asked again."""

    reason: str


class Costed(NamedTuple):
    """The answer to AskCost."""

    goal: str
    queue: int
    cost: Optional[float]
    reason: str = ""


class Ended(NamedTuple):
    """An execution has ended, and nothing of it moves any more."""

    goal: str
    achieved: bool
    outcome: str
    reason: str = ""


class Known(NamedTuple):
    """The robot's knowledge base has these facts of a predicate that the robot writes."""

    predicate: str
    facts: Optional[Tuple[str, ...]]
    """None: they cannot be read."""
    version: int


class Tell(NamedTuple):
    """The robot says this of itself, until it says something else."""

    kind: str
    """Of the key: SCHEMAS or STATUS."""
    record: Union[Schema, Status]


class Obeyed(NamedTuple):
    """The answer to Obey: the robot's status says how it went."""

    revision: int


class Timed(NamedTuple):
    """The answer to AskTime."""

    at: float
    """When, by the clock that is never set."""
    wall: Optional[float]
    """s since 1970, by the store's clock; None: no answer came."""


class Leaving(NamedTuple):
    """The robot leaves the fleet: it no longer takes goals."""


_OfStore = Union[Connected, Resumed, Changed, Disconnected, Leased, Answered, Refused, Full, Failed, Timed]
_OfRobot = Union[Costed, Ended, Known, Tell, Obeyed, Leaving]
Event = Union[_OfStore, _OfRobot, None]

# --- decisions --------------------------------------------------------------------------------------


class AskLease(NamedTuple):
    """Ask the store to renew a lease."""

    lease: int
    """0: ask for a new one."""


class Transact(NamedTuple):
    """Send a transaction; it is answered by its tag, in bounded time."""

    tag: str
    txn: Txn


class AskCost(NamedTuple):
    """Find out what a goal costs behind these."""

    goal: Goal
    behind: Tuple[Goal, ...]
    queue: int
    """Is returned with the answer."""


class AskTime(NamedTuple):
    """Ask the store for its time."""


class Begin(NamedTuple):
    """The robot begins to execute a goal."""

    goal: Goal


class StopExecution(NamedTuple):
    """Stop the execution of a goal. Its end is reported as always."""

    goal: str
    reason: str


class Obey(NamedTuple):
    """Stop the robot, and hold its base."""

    halt: Halt


class Learn(NamedTuple):
    """Take these for all facts of a predicate that another robot writes."""

    predicate: str
    facts: Tuple[str, ...]


class Say(NamedTuple):
    """Log a sentence for a person, once."""

    text: str


Decision = Union[AskLease, Transact, AskCost, AskTime, Begin, StopExecution, Obey, Learn, Say]

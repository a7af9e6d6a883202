# SPDX-License-Identifier: Apache-2.0
"""What the model of the ownership protocol is made of: its rules, books of leases, processes and the world.

The books are the real ones (`merlin_ros.actions.lease.LeaseBook`), kept by their contents.
"""

import copy
from functools import lru_cache
from typing import Dict, FrozenSet, Iterable, NamedTuple, Tuple

from merlin_ros.actions.lease import LeaseBook, LeaseChange, LeaseState
from merlin_ros.work.liveness import Limits

UP, HUNG, DEAD = "up", "hung", "dead"
LATE = "late "  # messages that are not read in this round

SUSPEND, LOSE, GONE = 1, 3, 2  # rounds of silence that the books bear
SILENCE = 4  # rounds without status that a client bears of a server that is connected
GONE_SILENCE = 1  # likewise, when the connection is closed
UNSEEN = 3  # rounds for which a server may not know a goal that was sent to it

Event = Tuple[str, ...]


class Rules(NamedTuple):
    """The protocol; each flag is one of its rules, so that a test can show what the rule is there for."""

    length: int = 3
    """Arrows of the chain."""
    leases_named: bool = True
    """A goal says that its client leases it: until a lease names it, it counts as named just now."""
    guard_asks: bool = True
    """Goals that ran before the guard began, or while it hung, move only when a lease has named them."""
    repeat_cancel: bool = True
    """A client repeats a cancel that shows no effect."""
    own_earlier_cancelled: bool = True
    """A client cancels goals of its own earlier lives when it reads of them."""
    server_leases: bool = True
    """The last server reads leases itself; the original move_base does not."""


# --- books ------------------------------------------------------------------------------------------

_books: Dict[tuple, LeaseBook] = {}


def _key(book: LeaseBook, names: Iterable[str] = ()) -> tuple:
    """What a book says of its goals now, and after how many rounds of silence it loses those of each owner.

    :param names: of the goals that it may know.
    """
    owners = {name: book.owner(name) for name in sorted(names) if book.owner(name)}
    goals = tuple((name, owner, str(life_of(name)), book.state(name).value) for name, owner in owners.items())
    later, rounds = copy.deepcopy(book), []
    for number in range(LOSE + 1):
        changes = later.pass_time(1.0, owners.values())
        rounds += [(owner, number) for owner in sorted({owners[goal] for goal in _lost(changes)})]
    key = (goals, tuple(rounds))
    _books.setdefault(key, book)
    return key


def _names(key: tuple) -> Tuple[str, ...]:
    return tuple(entry[0] for entry in key[0])


def _lost(changes: Iterable[LeaseChange]) -> Tuple[str, ...]:
    return tuple(change.goal for change in changes if change.state is LeaseState.LOST)


@lru_cache(maxsize=None)
def renewed(key: tuple, owner: str, life: str, held: tuple, suspended: tuple) -> Tuple[tuple, tuple]:
    """The book after a lease, and the goals that it has lost by it."""
    book = copy.deepcopy(_books[key])
    changes = book.renew(owner, life, held, suspended)
    return _key(book, {*_names(key), *held}), _lost(changes)


@lru_cache(maxsize=None)
def passed(key: tuple, connected: Tuple[str, ...]) -> Tuple[tuple, tuple]:
    """The book one round later, and the goals that it has lost by it."""
    book = copy.deepcopy(_books[key])
    changes = book.pass_time(1.0, connected)
    return _key(book, _names(key)), _lost(changes)


@lru_cache(maxsize=None)
def forgotten(key: tuple, goal: str) -> tuple:
    """The book without a goal."""
    book = copy.deepcopy(_books[key])
    book.forget(goal)
    return _key(book, _names(key))


def expected(key: tuple, owner: str, goal: str) -> tuple:
    """The book when a goal counts as named by its coming, where no lease has named it."""
    if state_of(key, goal) is not LeaseState.FOREIGN:
        return key
    life = str(life_of(goal))
    known = [entry for entry in key[0] if entry[1] == owner and entry[3] != LeaseState.LOST.value]
    if any(entry[2] != life for entry in known):
        known = []  # of an earlier life
    held = (*(name for name, *_ in known), goal)
    suspended = tuple(name for name, _, _, state in known if state == LeaseState.SUSPENDED.value)
    return renewed(key, owner, life, held, suspended)[0]


def state_of(key: tuple, goal: str) -> LeaseState:
    """The state of a goal in a book."""
    return _books[key].state(goal)


# --- processes --------------------------------------------------------------------------------------

EMPTY = _key(LeaseBook(Limits(LOSE, SUSPEND, GONE, closed_silent=SUSPEND)))


class Job(NamedTuple):
    """What a process carries out: a goal, and the goal that it has sent on for it."""

    goal: str
    cancelled: bool = False
    child: str = ""
    seen: bool = False
    """Whether a status list has named the child."""
    age: int = 0
    """Rounds since the child was sent, up to `UNSEEN`."""
    asked: bool = False
    """Whether a cancel was sent."""


class Process(NamedTuple):
    """A process of the chain."""

    state: str = UP
    life: int = 0
    jobs: Tuple[Job, ...] = ()
    book: tuple = EMPTY
    heard: int = 0
    """Highest life of its client that a lease came from."""
    silence: int = 0
    """Rounds without a status list from its server."""
    given_up: Tuple[str, ...] = ()
    """Goals that it has sent, does not want any more, and has not seen the end of."""


class Guard(NamedTuple):
    """The guard."""

    state: str = UP
    book: tuple = EMPTY
    heard: int = 0
    listed: Tuple[str, ...] = ()
    fresh: bool = True
    begun: bool = False
    """Whether it has read a status list."""
    earlier: Tuple[str, ...] = ()
    """Goals of the first list that no lease has named yet."""


class World(NamedTuple):
    """Everything at one moment. `wires` holds messages by (kind, arrow): those under way, oldest first."""

    processes: Tuple[Process, ...]
    guard: Guard
    wires: Tuple[Tuple[Tuple[str, int], tuple], ...] = ()
    unowned: Tuple[Tuple[str, int], ...] = ()
    """By goal at the last server: rounds since it lost its living owner."""


GUARD = -1  # stands for the guard in wires and events


def action_of(goal: str) -> str:
    """The action of a goal id: ``<process>.<life>.<action>``."""
    return goal.rsplit(".", 1)[1]


def life_of(goal: str) -> int:
    """The life of the process that sent it."""
    return int(goal.split(".")[1])


def begin(rules: Rules, actions: str) -> World:
    """All live; the first one has just sent its goals."""
    jobs = tuple(Job(goal=f"want.0.{action}") for action in actions)
    first = Process(jobs=jobs)
    return World((first,) + tuple(Process() for _ in range(rules.length)), Guard())


def passing(world: World) -> FrozenSet[str]:
    """The goals whose motion reaches the wheels."""
    guard, last = world.guard, world.processes[-1]
    if guard.state != UP or last.state != UP or not guard.fresh:
        return frozenset()
    return frozenset(
        job.goal
        for job in last.jobs
        if job.goal in guard.listed
        and job.goal not in guard.earlier
        and state_of(guard.book, job.goal) in (LeaseState.FOREIGN, LeaseState.HELD)
    )

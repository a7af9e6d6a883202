# SPDX-License-Identifier: Apache-2.0
"""What the keys of a fleet hold: JSON objects, each with one writer or written once."""

import functools
import json
import math
import re
import zlib
from typing import Any, Callable, Dict, List, NamedTuple, Optional, Tuple

#: Version of keys and records. A hub with another one is not joined.
PROTOCOL = 4
#: Texts of a kind that are kept parsed: with many robots in a process the slowest one is that far behind.
ONCE = 4096
#: Characters of a record: the hub sends 500 at once, which have to fit into a message (`hub.LARGEST`).
LONGEST_RECORD = 100_000
#: Characters of a reason: etcd takes 1.5 MB at once.
LONGEST_REASON = 2000
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}\Z")

#: Kinds of keys. Each key has one kind of writer (`Keys.of_robot`, `Keys.of_clients`); ABOUT is one key.
ABOUT, GOALS, CLAIMS, CANCELS, ENDS, FAILURES = "about", "goals", "claims", "cancels", "ends", "failures"
LIVES, BIDS, ROBOTS, LATE, TAKEN = "lives", "bids", "robots", "late", "taken"
FACTS, HALTS = "facts", "halts"
#: What a robot says of itself. Only clients follow these.
SCHEMAS, STATUS = "schemas", "status"
#: Marks are apart by goals, so that claims of different goals seldom meet. Each is a right of each robot.
MARK_PARTS = tuple(f"{part:02x}" for part in range(256))


class RecordError(ValueError):
    """A record that this version cannot read, or a name that is not allowed."""


def checked_name(name: str, what: str) -> str:
    """A name that can be part of a key.

    :raises RecordError: for any other.
    """
    if not NAME.match(name):
        raise RecordError(f"{what} '{name}' is not a word of letters, digits, '_', '.' and '-'")
    return name


class Keys:
    """The keys of one fleet.

    :param fleet: its name.
    """

    def __init__(self, fleet: str) -> None:
        self.root = f"/merlin/{checked_name(fleet, 'the fleet')}/"
        self.robots_end = self.root + ROBOTS
        """The keys before it are all that robots follow."""
        self.clients_end = self.root + TAKEN
        """The keys before it are all that clients follow; what is behind it only transactions compare."""

    def key(self, kind: str, *names: str) -> str:
        """The full key of a kind, such as ``goals``, and the names below it."""
        return self.root + "/".join([kind, *names])

    def of_robot(self, robot: str) -> List[str]:
        """The keys that a robot writes, and no other one; with '/' at the end, all that begin so."""
        below = [self.key(kind, robot, "") for kind in (CLAIMS, ENDS, FAILURES, LATE, FACTS)]
        return [
            *below,
            *(self.key(kind, robot) for kind in (LIVES, BIDS, ROBOTS, HALTS, SCHEMAS, STATUS)),
            *(self.key(TAKEN, part, robot) for part in MARK_PARTS),
        ]

    def of_clients(self) -> List[str]:
        """With what the keys begin that clients write."""
        return [self.key(kind, "") for kind in (GOALS, CANCELS, HALTS)]

    def marks(self, goal: str) -> str:
        """With what the marks of a goal begin: one for each robot that ever claimed a goal of its part.

        A robot writes its mark with each claim. So a claim is the only one if no mark was written since the
        robot knew the goal as open: the robots exclude each other, and each writes its own keys only.
        """
        return self.key(TAKEN, MARK_PARTS[zlib.crc32(goal.encode()) % len(MARK_PARTS)], "")

    def parts(self, key: str) -> Tuple[str, ...]:
        """Kind and names of a key; empty for one of another fleet."""
        return tuple(key[len(self.root) :].split("/")) if key.startswith(self.root) else ()


class Goal(NamedTuple):
    """A goal as it was sent; never changed afterwards."""

    id: str
    goals: Tuple[str, ...]
    """What has to hold, each as PDDL text."""
    sent: float
    """s since 1970, by the sender's clock."""
    sender: str = ""
    domain: str = ""
    """Name of the PDDL domain, or its name and hash as a robot writes them; empty: any domain."""
    deadline: Optional[float] = None
    """s since 1970; a goal that is not begun by then ends as MISSED."""
    value: float = 0.0
    """Greater ones are taken and begun first."""
    robot: str = ""
    """The only robot that may execute it."""
    groups: Tuple[str, ...] = ()
    """Groups of robots that may do it; empty: any."""
    needs: Tuple[str, ...] = ()
    """Capabilities of which the robot has all."""
    finish: bool = False
    """Its owner finishes it without a lease; no other robot gets it."""
    tries: int = 1
    """After so many failures, each of another robot, it has failed."""


class Claim(NamedTuple):
    """The ownership of a goal, or of a robot's name. Its epoch is the revision at which it was written."""

    robot: str
    life: str
    """Of the process; empty: the owner stands, and gives the goal back."""
    epoch: int = 0
    ttl: float = 0.0
    """s after its last renewal within which all that moves for the goal stands (`LeaseTimes`)."""


class Report(NamedTuple):
    """How the execution of a goal ended."""

    goal: str
    robot: str
    epoch: int
    outcome: str
    reason: str
    at: float
    """s since 1970, by the robot's clock."""


class Bid(NamedTuple):
    """What a goal would cost a robot, or why it does not bid."""

    cost: Optional[float]
    """s until it would hold, behind the robot's own queue; None: it does not bid."""
    reason: str = ""


class Bids(NamedTuple):
    """All bids of a robot."""

    of: Dict[str, Bid] = {}
    """Id of the goal → bid."""
    reason: str = ""
    """Why it bids for no goal at present; empty: it does."""


class Profile(NamedTuple):
    """A robot, as it describes itself."""

    name: str
    groups: Tuple[str, ...] = ()
    capabilities: Tuple[str, ...] = ()
    domain: str = ""
    """Name and hash: `home@1a2b3c4d`."""
    heard: float = 0.0
    """s since 1970, by the robot's clock, when it wrote this."""


class Halt(NamedTuple):
    """A client asks that a robot stops, and holds its base. The robot removes it when it has done so."""

    by: str
    at: float
    """s since 1970, by the client's clock."""
    revision: int = 0
    """At which it was written."""


class Schema(NamedTuple):
    """What a goal for a robot can be about."""

    domain: str
    """PDDL: types, constants, predicates and functions of its domain."""
    objects: Tuple[str, ...] = ()
    """Each with its type: `kitchen poi`."""


class Status(NamedTuple):
    """What a robot does, as it says itself."""

    doing: Tuple[str, ...] = ()
    """Actions that run: `navigate from=hall to=kitchen`."""
    goals: Tuple[str, ...] = ()
    """Of the request that runs, PDDL."""
    stage: str = ""
    """Of the Executor; empty: it has nothing to do."""
    trouble: str = ""
    """Why nothing more is known."""
    place: str = ""
    """Point of interest at which it is; empty: none."""
    x: Optional[float] = None
    """m in the frame of its map; None: not known."""
    y: Optional[float] = None
    hold: str = ""
    """How its base is held, as a sentence; empty: its guard does not say so."""
    stop: int = 0
    """Revision of the last `Halt` that this process has carried out."""
    page: str = ""
    """Address of its own page; empty: none that others reach."""
    at: float = 0.0
    """s since 1970, by the robot's clock."""


class Facts(NamedTuple):
    """All facts of a predicate, as the robot knows them that writes it."""

    robot: str
    predicate: str
    facts: Tuple[str, ...]
    """The arguments of each, with blanks."""
    version: int
    """Of the robot's knowledge base."""
    life: str
    """Lease that keeps them valid; empty: the knowledge base cannot be read."""


def reason_text(text: str) -> str:
    """A reason as a record can hold it: of characters that can be printed, and not too long."""
    return text[:LONGEST_REASON].encode(errors="replace").decode()


def encode(record: Any) -> str:
    """A record as JSON."""
    return json.dumps({"protocol": PROTOCOL, **record._asdict()}, sort_keys=True)


def encode_bids(bids: Bids) -> str:
    """The bids of a robot as JSON."""
    offers = {goal: list(bid) for goal, bid in bids.of.items()}
    return json.dumps({"protocol": PROTOCOL, "bids": offers, "reason": bids.reason})


def encode_cancel(by: str, at: float) -> str:
    """A cancel as JSON.

    :param by: the client.
    :param at: s since 1970.
    """
    return json.dumps({"protocol": PROTOCOL, "by": by, "at": at})


def decode_cancel(text: str) -> float:
    """When a goal was cancelled, s since 1970; 0: not known. A cancel is one whatever it says."""
    try:
        at = _json(text).get("at")
    except (RecordError, AttributeError):
        return 0.0
    return float(at) if _is_number(at) else 0.0


def encode_about(fleet_id: str) -> str:
    """The value of the key `about`: it distinguishes fleets of the same name."""
    return json.dumps({"protocol": PROTOCOL, "id": fleet_id})


def _json(text: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise RecordError(f"it is not JSON ({error})") from None


def _object(text: str) -> Dict[str, Any]:
    found = _json(text)
    if not isinstance(found, dict):
        raise RecordError("it is not a JSON object")
    version = found.pop("protocol", None)
    if version != PROTOCOL:
        raise RecordError(f"it is of protocol {version}, this is protocol {PROTOCOL}")
    return found


def decode(kind: Any, text: str) -> Any:
    """A record from JSON.

    :param kind: Goal, Claim, Report, Profile, Facts, Halt, Schema or Status.
    :raises RecordError: for what is not one.
    """
    found = _object(text)
    checks = _checks(kind)
    for name, value in found.items():
        if name not in checks:
            raise RecordError(f"a {kind.__name__} has no '{name}'")
        if not checks[name](value):
            what = "not a list of texts" if checks[name] is _is_texts else repr(value)
            raise RecordError(f"'{name}' is {what}")
        if checks[name] is _is_texts:
            found[name] = tuple(value)
    try:
        return kind(**found)
    except TypeError as error:
        raise RecordError(str(error)) from None


@functools.lru_cache(maxsize=None)
def _checks(kind: Any) -> Dict[str, Callable[[Any], bool]]:
    """Field of a record → whether a value fits it."""
    of_types = {
        float: _is_number,
        Optional[float]: lambda value: value is None or _is_number(value),
        int: lambda value: isinstance(value, int) and not isinstance(value, bool),
        bool: lambda value: isinstance(value, bool),
        str: _is_text,
        Tuple[str, ...]: _is_texts,
    }
    return {name: of_types[type_] for name, type_ in kind.__annotations__.items()}


def _is_number(value: Any) -> bool:
    """Whether it is one that a float can hold."""
    if not isinstance(value, (int, float)) or isinstance(value, bool):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:
        return False


def _is_text(value: Any) -> bool:
    """Whether it is a text that can be printed: JSON can hold halves of characters."""
    if not isinstance(value, str):
        return False
    try:
        return value.isascii() or bool(value.encode())
    except UnicodeEncodeError:
        return False


def _is_texts(value: Any) -> bool:
    return isinstance(value, list) and all(map(_is_text, value))


@functools.lru_cache(maxsize=ONCE)
def decode_bids(text: str) -> Bids:
    """The bids of a robot, decoded once for all robots of a process. They are not to be changed.

    :raises RecordError: for what is not bids.
    """
    found = _object(text)
    bids, reason = found.get("bids"), found.get("reason", "")
    if not isinstance(bids, dict) or not _is_text(reason):
        raise RecordError("these are not bids")
    read = {}
    for goal, bid in bids.items():
        try:
            cost, why = bid
        except (TypeError, ValueError):
            cost = why = None
        if not _is_text(why) or not (cost is None or _is_number(cost)):
            raise RecordError(f"this is not a bid: {bid!r}")
        read[goal] = Bid(cost, why)
    return Bids(read, reason)


def decode_about(text: str) -> str:
    """The id of a fleet.

    :raises RecordError: for another protocol.
    """
    found = _object(text).get("id")
    if not isinstance(found, str):
        raise RecordError("it has no id")
    return found


#: For the small records that each robot of a process reads: a text is parsed once for all of them.
decode_once = functools.lru_cache(maxsize=ONCE)(decode)

# SPDX-License-Identifier: Apache-2.0
"""When each guest comes, what it orders, and what goes wrong: from the seed alone."""

from dataclasses import dataclass
from random import Random
from typing import Dict, List, Sequence, Tuple, Union

from merlin_restaurant.menu import MENU

NAMES = ("ann", "ben", "carla", "dan", "eva", "finn", "gina", "hugo")
TABLES = tuple(f"table_{number}" for number in range(1, 7))

UNCLEAR, MISSING, CHAIR, LEAVES, WALKS_OFF = "unclear", "missing", "chair", "leaves", "walks_off"
#: What can go wrong on purpose: its name, and what it is.
DISTURBANCES = {
    UNCLEAR: "is not understood twice",
    MISSING: "an item is missing at the bar",
    CHAIR: "a chair blocks the way",
    LEAVES: "leaves while the order is under way",
    WALKS_OFF: "walks off on the way to the table",
}


class ScheduleError(ValueError):
    """An evening that cannot be; the text says why."""


@dataclass(frozen=True)
class GuestPlan:
    """What one guest means to do. Times are s of simulated time.

    :ivar name: of the person in the simulated world.
    :ivar table: where the guest sits when the evening begins; empty: comes to the entrance.
    :ivar comes: after the beginning.
    :ivar order: items of the menu.
    :ivar thinking: from sitting down to calling the robot.
    :ivar eating: from being served to leaving.
    :ivar cleared: from leaving to the clearing of the table; 0: it stays as it is.
    :ivar pace: m/s.
    :ivar disturbances: names out of DISTURBANCES.
    """

    name: str
    table: str
    comes: float
    order: Tuple[str, ...]
    thinking: float
    eating: float
    cleared: float
    pace: float
    disturbances: Tuple[str, ...]


def make_schedule(
    guests: int, seed: int, disturbances: Union[int, Sequence[str]], haste: float = 1.0
) -> List[GuestPlan]:
    """The guests of one evening.

    :param guests: how many, 1 to 8.
    :param seed: same seed, same evening.
    :param disturbances: which of DISTURBANCES there are, each once; or how many of them, drawn by the seed.
    :param haste: how many times faster they come, think and eat.
    :raises ScheduleError: what cannot be.
    """
    if not 1 <= guests <= len(NAMES):
        raise ScheduleError(f"{guests} guests cannot be; there may be 1 to {len(NAMES)}")
    if not 0.1 <= haste <= 100.0:
        raise ScheduleError(f"haste is {haste:g}; give 0.1 to 100")
    random = Random(f"evening {guests} {seed}")
    kinds = _kinds(disturbances, guests, random)
    # A guest that walks off has to be on the way to a table; guests that sit already are not.
    seated = min(max(1, guests // 3), guests - (WALKS_OFF in kinds))
    tables = random.sample(TABLES, seated)
    disturbed = _who_is_disturbed(kinds, guests, seated, random)
    dirty = random.sample(range(guests), 2 if guests > 3 else 1)
    comes = 20.0
    plans = []
    for number in range(guests):
        at_table = number < seated
        if not at_table:
            comes += random.uniform(150.0, 220.0) / haste
        disturbances_of = disturbed.get(number, ())
        items = 2 if MISSING in disturbances_of else random.choice((1, 2))
        plans.append(
            GuestPlan(
                name=NAMES[number],
                table=tables[number] if at_table else "",
                comes=0.0 if at_table else round(comes, 1),
                order=tuple(sorted(random.sample(MENU, items), key=MENU.index)),
                thinking=round(random.uniform(8.0, 40.0) / haste, 1),
                eating=round(random.uniform(60.0, 120.0) / haste, 1),
                cleared=0.0 if number in dirty else round(random.uniform(30.0, 60.0) / haste, 1),
                pace=round(random.uniform(0.4, 0.6), 2),
                disturbances=disturbances_of,
            )
        )
    return plans


def _kinds(disturbances: Union[int, Sequence[str]], guests: int, random: Random) -> List[str]:
    if isinstance(disturbances, int):
        if not 0 <= disturbances <= min(guests, len(DISTURBANCES)):
            raise ScheduleError(
                f"{disturbances} disturbances cannot be; each needs a guest and a kind, so with {guests} "
                f"guests there may be 0 to {min(guests, len(DISTURBANCES))}"
            )
        return random.sample(list(DISTURBANCES), disturbances)
    unknown = [kind for kind in disturbances if kind not in DISTURBANCES]
    if unknown:
        raise ScheduleError(f"{unknown[0]!r} cannot be; disturbances are {', '.join(DISTURBANCES)}")
    return list(dict.fromkeys(disturbances))


def _who_is_disturbed(
    kinds: Sequence[str], guests: int, seated: int, random: Random
) -> Dict[int, Tuple[str, ...]]:
    """Number of a guest → disturbances; a guest has several only when there are more of them than guests."""
    free = random.sample(range(guests), guests)
    found: Dict[int, Tuple[str, ...]] = {}
    if WALKS_OFF in kinds:
        walker = next(number for number in free if number >= seated)
        free.remove(walker)
        found[walker] = (WALKS_OFF,)
    others = [kind for kind in DISTURBANCES if kind in kinds and kind not in (WALKS_OFF, LEAVES)]
    if LEAVES in kinds and free:
        # A guest that leaves gets nothing from the bar, but can be hard to understand.
        leaver = free.pop()
        found[leaver] = (LEAVES,)
        if UNCLEAR in kinds and not free:
            others.remove(UNCLEAR)
            found[leaver] = (UNCLEAR, LEAVES)
    elif LEAVES in kinds:
        others.append(LEAVES)
    if others and not free:
        raise ScheduleError(
            f"{others[0]} cannot be with {guests} guests, because a guest that leaves or walks off gets "
            "nothing; more guests are needed"
        )
    for number, kind in enumerate(others):
        guest = free[number % len(free)]
        found[guest] = (*found.get(guest, ()), kind)
    return found


def without_one(order: Tuple[str, ...], random: Random) -> List[str]:
    """An order of which an item is missing."""
    left = list(order)
    del left[random.randrange(len(left))]
    return left


def wrong_order(order: Tuple[str, ...], random: Random) -> List[str]:
    """What a careless barman puts on the bar: something is missing, or something else stands there."""
    if len(order) > 1 and random.random() < 0.5:
        return without_one(order, random)
    items = list(order)
    items[random.randrange(len(items))] = random.choice([item for item in MENU if item not in order])
    return items

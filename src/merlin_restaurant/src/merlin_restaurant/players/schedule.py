"""Who comes when, orders what, and what goes wrong: from the seed alone."""

from dataclasses import dataclass
from random import Random
from typing import List, Tuple

from merlin_restaurant.menu import MENU

NAMES = ("ann", "ben", "carla", "dan", "eva", "finn", "gina", "hugo")
TABLES = tuple(f"table_{number}" for number in range(1, 7))

LEAVES = "leaves while the order is under way"
CHAIR = "a chair blocks the way"
WRONG = "the order is wrong at the bar"
MUMBLES = "is not understood twice"
WALKS_OFF = "walks off on the way to the table"
DISTURBANCES = (WRONG, LEAVES, MUMBLES, WALKS_OFF, CHAIR)


class ScheduleError(ValueError):
    """An evening that cannot be; the text says why."""


@dataclass(frozen=True)
class GuestPlan:
    """What one guest means to do. Times are s of simulated time.

    Attributes:
        name: of the person in the simulated world.
        table: where the guest sits when the evening begins; empty: comes to the entrance.
        comes: after the beginning.
        order: items of the menu.
        thinking: from sitting down to calling the robot.
        eating: from being served to leaving.
        cleared: from leaving to the clearing of the table; 0: it stays as it is.
        pace: m/s.
        disturbance: one of DISTURBANCES; empty: none.
    """

    name: str
    table: str
    comes: float
    order: Tuple[str, ...]
    thinking: float
    eating: float
    cleared: float
    pace: float
    disturbance: str


def make_schedule(guests: int, seed: int, disturbances: int, haste: float = 1.0) -> List[GuestPlan]:
    """The guests of one evening.

    :param guests: how many, 1 to 8.
    :param seed: same seed, same evening.
    :param disturbances: how many guests are disturbed, each by another of DISTURBANCES.
    :param haste: how many times faster they come, think and eat.
    :raises ScheduleError: numbers out of range.
    """
    if not 1 <= guests <= len(NAMES):
        raise ScheduleError(f"{guests} guests cannot be; there may be 1 to {len(NAMES)}")
    if not 0 <= disturbances <= min(guests, len(DISTURBANCES)):
        raise ScheduleError(
            f"{disturbances} disturbances cannot be; each needs a guest and a kind, so with {guests} guests "
            f"there may be 0 to {min(guests, len(DISTURBANCES))}"
        )
    if not 0.1 <= haste <= 100.0:
        raise ScheduleError(f"a haste of {haste:g} cannot be; 0.1 to 100")
    random = Random(f"evening {guests} {seed}")
    seated = max(1, guests // 3)
    tables = random.sample(TABLES, seated)
    kinds = random.sample(DISTURBANCES, disturbances)
    # Who walks off has to be on the way to a table; guests who sit already are not.
    order = sorted(kinds, key=lambda kind: kind == WALKS_OFF)
    if WALKS_OFF in kinds and seated == guests:
        raise ScheduleError("a guest who walks off has to come first; more guests are needed")
    places = random.sample(range(guests), disturbances)
    if WALKS_OFF in kinds and max(places) < seated:
        places[0] = guests - 1
    places.sort()
    disturbed = dict(zip(places, order))
    dirty = random.sample(range(guests), 2 if guests > 3 else 1)
    comes = 20.0
    plans = []
    for number in range(guests):
        at_table = number < seated
        if not at_table:
            comes += random.uniform(100.0, 160.0) / haste
        plans.append(
            GuestPlan(
                name=NAMES[number],
                table=tables[number] if at_table else "",
                comes=0.0 if at_table else round(comes, 1),
                order=tuple(sorted(random.sample(MENU, random.choice((1, 2))), key=MENU.index)),
                thinking=round(random.uniform(8.0, 40.0) / haste, 1),
                eating=round(random.uniform(60.0, 120.0) / haste, 1),
                cleared=0.0 if number in dirty else round(random.uniform(30.0, 60.0) / haste, 1),
                pace=round(random.uniform(0.4, 0.6), 2),
                disturbance=disturbed.get(number, ""),
            )
        )
    return plans


def wrong_order(order: Tuple[str, ...], random: Random) -> List[str]:
    """What a careless barman puts on the bar: something is missing, or something else stands there."""
    items = list(order)
    place = random.randrange(len(items))
    if len(items) > 1 and random.random() < 0.5:
        del items[place]
    else:
        items[place] = random.choice([item for item in MENU if item not in order])
    return items

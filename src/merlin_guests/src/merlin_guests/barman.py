# SPDX-License-Identifier: Apache-2.0
"""The barman: prepares what the robot orders, sometimes wrongly, and loads it; and clears tables."""

import re
from random import Random
from typing import Callable, Dict, List, Optional, Sequence, Tuple

from merlin_msgs.msg import GuestEvent

from merlin_guests.guest import Guest
from merlin_guests.house import House, tray_of
from merlin_guests.schedule import DISTURBANCES, MISSING, without_one, wrong_order
from merlin_guests.stage import Stage
from merlin_restaurant.menu import items_in

NAME = "barman"
PREPARES = 8.0  # s
MENDS = 4.0  # s
WRONG = "the order is wrong at the bar"
READY = "your order is ready"
ANSWERS = {
    "i am sorry": "all right",
    "ordered": "all right",
    "put the order": "here you are",
    "take the order": "all right",
}


class Barman:
    """Serves the robots until the evening is over.

    :param wrong_share: of the orders that are wrong at first, 0..1.
    :param guest_of: returns the guest at a table; None: the table is free.
    """

    def __init__(
        self,
        stage: Stage,
        house: House,
        seed: int,
        wrong_share: float,
        guest_of: Callable[[str], Optional[Guest]],
    ) -> None:
        self._stage = stage
        self._house = house
        self._random = Random(f"barman {seed}")
        self._wrong_share = wrong_share
        self._guest_of = guest_of
        self._orders: Dict[str, Tuple[str, List[str]]] = {}  # place at the bar → table and what it ordered

    def play(self) -> None:
        """Works.

        :raises Closed: the evening is over.
        """
        self._stage.answer(NAME, ANSWERS)
        tables: Dict[str, str] = {}  # robot → the table of which it spoke
        while True:
            said = self._stage.hear(NAME, "", 3600.0)
            robot = self._stage.speaker(NAME)
            found = re.search(r"table \d+", said)
            if found:
                tables[robot] = found.group().replace(" ", "_")
            table = tables.get(robot, "")
            if "i am sorry" in said:
                self._mend(robot)
            elif found and "ordered" in said:
                self._prepare(table, items_in(said[found.end() :]), robot)
            elif "put the order" in said:
                self._load(table, robot)
            elif "take the order" in said:
                self._house.take(tray_of(robot))

    def _prepare(self, table: str, items: Sequence[str], robot: str) -> None:
        counter = self._house.counter_of(robot)
        if self._orders.get(counter) == (table, list(items)) and self._house.on(counter):
            self._stage.call(READY, NAME, robot)  # the robot did not hear that, and ordered again
            return
        self._orders[counter] = table, list(items)
        self._house.take(counter)
        self._stage.wait(PREPARES)
        guest = self._guest_of(table)
        missing = guest is not None and MISSING in guest.plan.disturbances
        if missing or self._random.random() < self._wrong_share:
            spoil = without_one if missing else wrong_order
            wrong = spoil(tuple(items), self._random)
            self._stage.publish(
                GuestEvent.DISTURBED,
                guest.plan.name if guest else "",
                table,
                wrong,
                f"{DISTURBANCES[MISSING] if missing else WRONG}: "
                f"{' and '.join(wrong)} instead of {' and '.join(items)}",
            )
            self._house.put(counter, wrong)
        else:
            self._house.put(counter, items)
        self._stage.call(READY, NAME, robot)

    def _mend(self, robot: str) -> None:
        counter = self._house.counter_of(robot)
        self._stage.wait(MENDS)
        self._house.take(counter)
        self._house.put(counter, self._orders.get(counter, ("", []))[1])
        self._stage.call(READY, NAME, robot)

    def _load(self, table: str, robot: str) -> None:
        tray = tray_of(robot)
        self._house.put(tray, self._house.take(self._house.counter_of(robot)))
        guest = self._guest_of(table)
        if guest is not None:
            guest.tray_is_loaded(self._house.on(tray))

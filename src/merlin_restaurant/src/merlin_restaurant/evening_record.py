# SPDX-License-Identifier: Apache-2.0
"""The record of an evening: what happened to each guest, what the robot did, and whether both agree."""

from collections import Counter
from dataclasses import dataclass, field
from typing import Dict, Iterable, List, Optional, Sequence, Tuple

from merlin_restaurant.menu import listed

#: Kinds of events, as in merlin_msgs/GuestEvent.
CAME, SEATED, CALLED, ORDERED, SERVED, LEFT, CLEARED, DISTURBED, CLOSED = range(9)
#: Reasons to leave that begin so are the robot's fault.
WAITED = "waited too long"
Items = Tuple[str, ...]


@dataclass
class GuestAccount:
    """The record of one guest. Times are s since the beginning; None: it did not happen.

    :ivar ordered_items: what the guest ordered.
    :ivar served_items: what the guest got.
    :ivar reason: why the guest left.
    :ivar calls: how often the guest called for the robot.
    :ivar errors: what went wrong, on purpose or not.
    """

    name: str
    table: str = ""
    came: Optional[float] = None
    seated: Optional[float] = None
    ordered: Optional[float] = None
    served: Optional[float] = None
    left: Optional[float] = None
    ordered_items: Items = ()
    served_items: Items = ()
    reason: str = ""
    calls: int = 0
    errors: List[str] = field(default_factory=list)

    @property
    def outcome(self) -> str:
        """In a few words."""
        if self.served is not None:
            return "served"
        return self.reason or "neither served nor gone"


class EveningRecord:
    """Two independent accounts: of the guests (truth), and of the robot (what it believes)."""

    def __init__(self) -> None:
        self.guests: Dict[str, GuestAccount] = {}
        self.closed: Optional[float] = None
        self.deliveries: List[Tuple[float, str, Items]] = []
        self._tables: Dict[str, str] = {}
        self._knowledge: Dict[str, str] = {}
        self._held: List[str] = []
        self._blocked: Sequence[str] = ()

    def guest_event(
        self, time: float, event: int, guest: str, table: str, items: Sequence[str], reason: str
    ) -> None:
        """Enters what happened to a guest."""
        if event == CLOSED:
            self.closed = time
            return
        if event == CLEARED:
            self._tables[table] = "ready"
            return
        if not guest:
            return
        account = self.guests.setdefault(guest, GuestAccount(guest))
        account.table = table or account.table
        if event == CAME:
            account.came = time
        elif event == SEATED:
            account.seated = time
            self._tables[table] = "needs_serving"
        elif event == CALLED:
            account.calls += 1
        elif event == ORDERED:
            account.ordered, account.ordered_items = time, tuple(sorted(items))
        elif event == SERVED:
            account.served, account.served_items = time, tuple(sorted(items))
            self._tables[table] = "already_served"
        elif event == LEFT:
            account.left, account.reason = time, reason
            if account.seated is not None:
                self._tables[table] = "ready" if account.served is None else "needs_cleaning"
        elif event == DISTURBED:
            account.errors.append(reason)

    def delivered(self, time: float, table: str, items: Iterable[str]) -> None:
        """Enters an order that the robot believes to have delivered."""
        self.deliveries.append((time, table, tuple(sorted(items))))

    def robot_failed(self, table: str, sentence: str) -> None:
        """Enters what the robot could not do at a table."""
        for account in self.guests.values():
            if account.table == table and account.left is None:
                account.errors.append(sentence)

    def close(self, states: Dict[str, str], held: Sequence[str], blocked: Sequence[str] = ()) -> None:
        """Enters what the robot knows at the end.

        :param states: of the tables.
        :param held: facts about orders under way.
        :param blocked: tables, ``bar`` or ``entrance`` where a robot stands that takes no actions: what waits
            there cannot be served, and a state of such a table cannot be known.
        """
        self._knowledge, self._held, self._blocked = dict(states), list(held), list(blocked)
        for account in self.guests.values():
            if self._is_blocked(account):
                account.errors.append("a robot that takes no actions stands in the way")

    def _is_blocked(self, account: GuestAccount) -> bool:
        """Whether a guest waited for what no robot could do."""
        needed = ("bar", account.table) if account.table else ("entrance",)
        return account.reason.startswith(WAITED) and any(place in self._blocked for place in needed)

    def truth(self, table: str) -> str:
        """The state that a table is in."""
        return self._tables.get(table, "ready")

    def problems(self) -> List[str]:
        """Why the books do not balance; empty: they do."""
        found = [] if self.closed is not None else ["the evening did not come to its end"]
        for account in self.guests.values():
            found += _account_problems(account) if not self._is_blocked(account) else []
        given = Counter(
            (account.table, account.served_items)
            for account in self.guests.values()
            if account.served is not None
        )
        believed = Counter((table, items) for _, table, items in self.deliveries)
        for (table, items), count in (believed - given).items():
            found.append(
                f"the robot believes it brought {_named(items)} to {table} {count} time(s) more than it did"
            )
        for (table, items), count in (given - believed).items():
            found.append(f"{_named(items)} came to {table} {count} time(s) more than the robot knows")
        for table, state in sorted(self._knowledge.items()):
            if state != self.truth(table) and table not in self._blocked:
                found.append(
                    f"the robot knows {table} as {state or 'nothing'}, but it is {self.truth(table)}"
                )
        found += [f"the robot still has to do with {fact}" for fact in self._held]
        return found

    def rows(self) -> List[Dict[str, object]]:
        """One row of COLUMNS per guest."""
        return [_row(account) for account in self.guests.values()]


def _row(account: GuestAccount) -> Dict[str, object]:
    return {
        "guest": account.name,
        "table": account.table,
        "came_s": account.came,
        "waited_for_table_s": _span(account.came, account.seated),
        "waited_for_waiter_s": _span(account.seated, account.ordered),
        "waited_for_order_s": _span(account.ordered, account.served),
        "ordered": " ".join(account.ordered_items),
        "served": " ".join(account.served_items),
        "calls": account.calls,
        "outcome": account.outcome,
        "errors": "; ".join(account.errors),
    }


def _account_problems(account: GuestAccount) -> List[str]:
    name = account.name
    if account.served is None:
        if not account.reason:
            return [f"{name} was neither served nor is there a reason"]
        return [f"{name} {account.reason}"] if account.reason.startswith(WAITED) else []
    if account.served_items != account.ordered_items:
        return [f"{name} ordered {_named(account.ordered_items)} and got {_named(account.served_items)}"]
    return []


def _span(start: Optional[float], end: Optional[float]) -> Optional[float]:
    return None if start is None or end is None else max(0.0, round(end - start, 1))


def _named(items: Sequence[str]) -> str:
    return listed(items) or "nothing"


#: Of the table per guest.
COLUMNS = tuple(_row(GuestAccount("")))

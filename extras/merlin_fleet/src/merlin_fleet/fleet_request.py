# SPDX-License-Identifier: Apache-2.0
"""A goal that was sent to a fleet, as its sender sees it."""

import getpass
import socket
from typing import TYPE_CHECKING, Dict, NamedTuple, Optional

from merlin_fleet.core.records import Goal, Report
from merlin_fleet.core.view import FleetGoalState

if TYPE_CHECKING:
    from merlin_fleet.fleet_client import FleetClient


#: Outcome of a goal that the fleet no longer keeps, and whose end was not received here.
REMOVED = "REMOVED"


class GoalNews(NamedTuple):
    """A goal as the fleet sees it at one moment."""

    goal: Goal
    state: FleetGoalState
    owner: str
    """The robot that has it; empty: none."""
    refusals: Dict[str, str]
    """Robot → why it does not bid, or what its bid lacks; while it is open."""
    report: Optional[Report]
    """How the goal ended; None: it is open."""
    hopeless: str = ""
    """While it is open: why it stays so as the fleet is now; empty: a robot may take it."""


class FleetRequest:
    """A goal that was sent to a fleet.

    :param client: of the fleet.
    :param goal: its id.
    :param written: revision at which the hub had it; 0: it is not known to have it.
    """

    def __init__(self, client: "FleetClient", goal: str, written: int = 0) -> None:
        self._client = client
        self.id = goal
        self._result: Optional[Report] = None
        self.taken(written)

    def taken(self, written: int) -> None:
        """The hub has the goal.

        :param written: at this revision.
        """
        self._store, self.written = self._client.stores, written

    @property
    def news(self) -> Optional[GoalNews]:
        """The state of the goal in the fleet; None: not received yet."""
        return self._client.news(self.id)

    @property
    def done(self) -> bool:
        """Whether it has ended."""
        return self.result is not None

    @property
    def result(self) -> Optional[Report]:
        """How it ended; None before. It stays known here when the fleet no longer keeps the goal."""
        # In this order: the goal may be heard of in between.
        seen = self._client.revision if self._client.stores == self._store else self.written
        news = self.news
        if news is not None and news.report is not None:
            self._result = news.report
        elif news is None and self._result is None and 0 < self.written <= seen:
            self._result = Report(self.id, "", 0, REMOVED, "the fleet no longer keeps it", 0.0)
        return self._result

    def cancel(self) -> None:
        """Asks its owner to stop it; without an owner it is over at once.

        :raises FleetError: when the hub did not take it.
        """
        self._client.cancel(self.id)

    def wait(self, timeout: Optional[float] = None) -> bool:
        """Waits for its end.

        :param timeout: s; None: as long as it takes.
        :return: whether it has ended.
        """
        return self._client.wait(lambda: self.done, timeout)


def own_name() -> str:
    """The user of this process and the machine: what senders are named by."""
    try:
        user = getpass.getuser()
    except (KeyError, OSError):  # a user without a name, as in a container
        user = "unknown"
    return f"{user}@{socket.gethostname()}"

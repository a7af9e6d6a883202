# SPDX-License-Identifier: Apache-2.0
"""Requests of an agenda, in virtual time."""

from typing import Optional

from merlin_executor.core.agenda import Agenda
from merlin_executor.core.outcome import Outcome, Verdict
from merlin_executor.core.ticket import Ticket
from merlin_executor.core.time_window import TimeWindow

CANCELLED = Verdict(Outcome.CANCELLED, "cancelled")
DONE = Verdict(Outcome.SUCCEEDED)
UNSOLVABLE = Verdict(Outcome.UNSOLVABLE, "the problem has no plan")
LIMIT = 60.0
MOST = 4


class Clock:
    now = 100.0

    def __call__(self) -> float:
        return self.now


class Errand(Ticket):
    under_way = False  # type: ignore[assignment]
    ends: Optional[float] = None

    def __init__(self, order: int, priority: int = 0, resumes: bool = True, **more: object) -> None:
        times = {name: more.pop(name) for name in ("not_before", "deadline") if name in more}
        super().__init__(order, priority, resumes, window=TimeWindow(**times), **more)  # type: ignore[arg-type]

    @property
    def expected_end(self) -> Optional[float]:
        return self.ends

    @property
    def text(self) -> str:
        return f"(checked room_{self.order})"


def go(agenda: "Agenda[Errand]") -> None:
    """The plan is carried out from now on."""
    for errand in agenda.together:
        errand.under_way = True

# SPDX-License-Identifier: Apache-2.0
"""Which of several errands are taken, and in which order, where not all can be in time. Pure.

A planner says how long each takes from here and from the end of each other one: the search knows these pairs
only. Up to :data:`EXACT` errands it looks at all orders. What the planner does not find in time is not known,
and never called impossible.
"""

import itertools
import math
from typing import Callable, Dict, List, NamedTuple, Optional, Sequence, Tuple

#: So many errands at most are searched for the best order; more are improved step by step.
EXACT = 10
_ROUNDS = 50  # of improvement


class Errand(NamedTuple):
    """What is to be done."""

    name: str
    deadline: float = math.inf
    """s from now until which it has to be done."""
    value: float = 1.0
    """What it is worth; above 0."""
    ready: float = 0.0
    """s from now before which it does not begin."""


class Answer(NamedTuple):
    """What a planner says of one errand, begun at some moment."""

    seconds: Optional[float] = None
    """Until it is done; None: the planner has not found out."""
    impossible: str = ""
    """Why it cannot be in time, as a sentence; empty: that is not proven."""


class Selection(NamedTuple):
    """What is taken in which order, and what is not and why."""

    taken: List[str]
    left_out: Dict[str, str]
    """Errand → why it is late whatever else is done, by the planner; empty: others are preferred."""


#: An errand, and the one whose end it begins from; None: it begins now → what the planner says.
Oracle = Callable[[str, Optional[str]], Answer]


def select(errands: Sequence[Errand], oracle: Oracle) -> Selection:
    """Chooses the errands that are worth most together, then those that are done first.

    :param errands: with different names.
    :param oracle: each question may cost a run of the planner; none is asked twice.
    """
    alone = {errand.name: oracle(errand.name, None) for errand in errands}
    late_by = {name: answer.impossible for name, answer in alone.items() if answer.impossible}
    known = [errand for errand in errands if alone[errand.name].seconds is not None]
    possible = [errand for errand in known if errand.name not in late_by]
    tour = _Tour(possible, alone, oracle)
    order = tour.exact() if len(possible) <= EXACT else tour.improved(tour.first())
    taken = [errand.name for errand in order]
    left_out = {errand.name: "" for errand in possible if errand.name not in taken}
    # Those of which nothing is known are tried when the others are done: they may be in time.
    unknown = [e for e in errands if alone[e.name].seconds is None and e.name not in late_by]
    unknown.sort(key=lambda errand: errand.deadline)
    return Selection([*taken, *(errand.name for errand in unknown)], {**left_out, **late_by})


Order = Tuple[Errand, ...]
#: Worth, then minus the end. The greater one is better.
_Rank = Tuple[float, float]


class _Tour:
    """Orders of errands, and when each would be done.

    :param alone: of each, begun now.
    """

    def __init__(self, errands: Sequence[Errand], alone: Dict[str, Answer], oracle: Oracle) -> None:
        self._errands = sorted(errands, key=lambda errand: errand.deadline)
        self._oracle = oracle
        self._seconds: Dict[Tuple[str, Optional[str]], float] = {
            (name, None): _seconds(answer) for name, answer in alone.items()
        }

    def end(self, errand: Errand, before: Optional[Errand], free: float) -> float:
        """When an errand is done behind another one; infinite: not in time, as far as is known.

        :param free: when that one is done.
        """
        begin = max(free, errand.ready)
        if begin > errand.deadline:
            return math.inf
        key = errand.name, before.name if before is not None else None
        if key not in self._seconds:
            self._seconds[key] = _seconds(self._oracle(*key))
        end = begin + self._seconds[key]
        return end if end <= errand.deadline else math.inf

    def ends(self, order: Sequence[Errand]) -> List[float]:
        """When each is done, up to the first that is late."""
        ends: List[float] = []
        before: Optional[Errand] = None
        free = 0.0
        for errand in order:
            free = self.end(errand, before, free)
            if free == math.inf:
                break
            ends.append(free)
            before = errand
        return ends

    def exact(self) -> Order:
        """The best order, by the earliest end of each set of errands for each last one."""
        best: Order = ()
        orders: Dict[Tuple[int, int], Tuple[float, Order]] = {(0, -1): (0.0, ())}
        for _ in self._errands:
            longer: Dict[Tuple[int, int], Tuple[float, Order]] = {}
            for (chosen, last), (free, order) in orders.items():
                before = self._errands[last] if last >= 0 else None
                for number, errand in enumerate(self._errands):
                    if chosen & 1 << number:
                        continue
                    end = self.end(errand, before, free)
                    key = chosen | 1 << number, number
                    if end < math.inf and end < longer.get(key, (math.inf, ()))[0]:
                        longer[key] = end, (*order, errand)
            orders = longer
            best = max([best, *(order for _, order in orders.values())], key=self._rank)
        return best

    def first(self) -> Order:
        """By the earliest deadline, without what would be late, or each where it costs least."""
        order: Order = ()
        by_deadline: Order = ()
        for errand in self._errands:
            order = self._inserted(order, errand) or order
            if len(self.ends((*by_deadline, errand))) > len(by_deadline):
                by_deadline = (*by_deadline, errand)
        return max(order, by_deadline, key=self._rank)

    def improved(self, order: Order) -> Order:
        """A better order, found by putting errands elsewhere, in place of others, and in addition."""
        for _ in range(_ROUNDS):
            better = max(self._neighbours(order), key=self._rank, default=order)
            if self._rank(better) <= self._rank(order):
                break
            order = better
        return order

    def _neighbours(self, order: Order) -> List[Order]:
        found = []
        for errand in self._errands:
            rest = tuple(other for other in order if other is not errand)
            found.append(self._inserted(rest, errand))
            if len(rest) == len(order):
                found += [self._inserted(order[:at] + order[at + 1 :], errand) for at in range(len(order))]
        for one, other in itertools.combinations(range(len(order)), 2):
            turned = order[:one] + order[one : other + 1][::-1] + order[other + 1 :]
            found.append(turned if len(self.ends(turned)) == len(turned) else None)
        return [each for each in found if each is not None]

    def _inserted(self, order: Order, errand: Errand) -> Optional[Order]:
        """With one more errand where it costs least; None: something would be late everywhere."""
        tries = [(*order[:place], errand, *order[place:]) for place in range(len(order) + 1)]
        fitting = [each for each in tries if len(self.ends(each)) == len(each)]
        return max(fitting, key=self._rank, default=None)

    def _rank(self, order: Sequence[Errand]) -> _Rank:
        return math.fsum(errand.value for errand in order), -max(self.ends(order), default=0.0)


def _seconds(answer: Answer) -> float:
    return math.inf if answer.seconds is None or answer.impossible else answer.seconds

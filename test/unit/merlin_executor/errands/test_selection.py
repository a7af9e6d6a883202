# SPDX-License-Identifier: Apache-2.0
"""Which errands are taken where not all can be in time, against all orders of all of them."""

import itertools
import math

from hypothesis import given, settings
from hypothesis import strategies as st

from merlin_executor.errands.selection import EXACT, Answer, Errand, select

EXAMPLES = settings(max_examples=150, deadline=None, derandomize=True, database=None)


class Town:
    """A planner: errands at places on a line, done in order; each question counts."""

    def __init__(self, places, unknown=()):
        self.places = dict(places)
        self.unknown = set(unknown)
        self.impossible = {}
        self.asked = []

    def __call__(self, name, before):
        self.asked.append((name, before))
        if name in self.unknown or (name, before) in self.unknown:
            return Answer()
        if name in self.impossible and before is None:
            return Answer(self.seconds(name, before), self.impossible[name])
        return Answer(self.seconds(name, before))

    def seconds(self, name, before):
        return 1.0 + abs(self.places[name] - self.places.get(before, 0))


def ends(order, town):
    """When each is done, or None when one is late."""
    free, before, found = 0.0, None, []
    for errand in order:
        free = max(free, errand.ready) + town.seconds(errand.name, before)
        if free > errand.deadline or max(errand.ready, 0.0) > errand.deadline:
            return None
        found.append(free)
        before = errand.name
    return found


def worth(order):
    return sum(errand.value for errand in order)


def best_of_all(errands, town):
    orders = (order for count in range(len(errands) + 1) for order in itertools.permutations(errands, count))
    fitting = [
        (worth(order), -max(ends(order, town), default=0.0))
        for order in orders
        if ends(order, town) is not None
    ]
    return max(fitting)


def errands_of(count):
    one = st.tuples(
        st.integers(-9, 9),
        st.integers(1, 40),
        st.sampled_from([1.0, 2.0, 5.0]),
        st.integers(0, 15),
    )
    return st.lists(one, min_size=1, max_size=count)


def made(rows):
    errands = [
        Errand(f"e{number}", float(deadline), value, float(ready))
        for number, (_, deadline, value, ready) in enumerate(rows)
    ]
    return errands, Town({f"e{number}": row[0] for number, row in enumerate(rows)})


@given(errands_of(5))
@EXAMPLES
def test_what_is_taken_is_worth_as_much_as_the_best_of_all_orders(rows):
    errands, town = made(rows)
    found = select(errands, town)
    by_name = {errand.name: errand for errand in errands}
    order = [by_name[name] for name in found.taken]
    assert (worth(order), -max(ends(order, town), default=0.0)) == best_of_all(errands, town)
    assert {*found.left_out, *found.taken} == set(by_name) and not any(found.left_out.values())
    assert len(set(town.asked)) == len(town.asked), "a question was asked twice"


@given(errands_of(20).filter(lambda rows: len(rows) > EXACT))
@settings(parent=EXAMPLES, max_examples=15)
def test_many_are_never_taken_worse_than_by_the_earliest_deadline(rows):
    errands, town = made(rows)
    found = select(errands, town)
    by_name = {errand.name: errand for errand in errands}
    order = [by_name[name] for name in found.taken]
    assert ends(order, town) is not None
    earliest = []
    for errand in sorted(errands, key=lambda errand: errand.deadline):
        if ends([*earliest, errand], town) is not None:
            earliest.append(errand)
    assert worth(order) >= worth(earliest)
    assert len(set(town.asked)) == len(town.asked)


def test_what_is_left_out_says_for_what_and_what_is_late_by_itself_says_why():
    town = Town({"kitchen": 4, "hall": -4, "moon": 4})
    town.impossible["moon"] = "needs 95 s, its deadline is in 60 s"
    found = select([Errand("moon", 60.0), Errand("kitchen", 6.0), Errand("hall", 6.0, value=2.0)], town)
    assert found.taken == ["hall"]
    assert found.left_out == {"moon": "needs 95 s, its deadline is in 60 s", "kitchen": ""}


def test_what_the_planner_does_not_find_out_is_not_left_out():
    town = Town({"kitchen": 1, "hall": 2}, unknown=["hall"])
    found = select([Errand("hall", 5.0), Errand("kitchen", 5.0)], town)
    assert found.taken == ["kitchen", "hall"] and found.left_out == {}


def test_a_way_that_is_not_known_is_not_gone():
    town = Town({"kitchen": 1, "hall": 2}, unknown=[("hall", "kitchen")])
    found = select([Errand("kitchen"), Errand("hall")], town)
    assert found.taken == ["hall", "kitchen"]


def test_errands_without_deadlines_are_all_taken_by_the_shortest_way():
    town = Town({f"e{place}": place for place in (3, 1, 2)})
    found = select([Errand(name) for name in town.places], town)
    assert found.taken == ["e1", "e2", "e3"]
    assert math.isinf(Errand("x").deadline)

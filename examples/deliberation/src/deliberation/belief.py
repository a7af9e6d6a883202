# SPDX-License-Identifier: Apache-2.0
"""What a robot knows of its house, as facts and values of the domain. Without ROS."""

from typing import Collection, Dict, FrozenSet, Iterator, List, Mapping, Optional, Set, Tuple

from deliberation.house import ANYWHERE, House, State, accessible

Fact = Tuple[str, ...]
Values = Dict[Fact, float]

#: Predicates and functions that the bridge keeps; effects of actions are left to it.
SENSED = (
    *("is_open", "accessible", "robot_at", "hand_empty", "holding", "is_at", "maybe_at"),
    *("battery", "drive_use", "drive_cost", "reserve"),
)
COST = 100.0  # of one try of an action
METRE_COST = 5.0  # of 1 m


class Belief:
    """What is known of the things: those that were never seen may be at any spot that was not looked at.

    :param house: its sites, which the robot knows.
    :param things: that there are, somewhere.
    :param at: thing → the spot where it is known to be.
    """

    def __init__(self, house: House, things: Collection[str], at: Optional[Mapping[str, str]] = None) -> None:
        self._house = house
        spots = house.of_kind("spot")
        self._at: Dict[str, str] = dict(at or {})
        self._maybe: Dict[str, Set[str]] = {
            thing: set() if thing in self._at else set(spots) for thing in sorted(things)
        }
        self._held = ""

    def looked(self, spot: str, found: Collection[str]) -> None:
        """All things at a spot were seen; those that were not are not there.

        A thing that was known to be there and is gone may be at any other spot.
        """
        for thing, maybe in self._maybe.items():
            if thing in found:
                self._at[thing] = spot
                maybe.clear()
            elif self._at.get(thing) == spot:
                del self._at[thing]
                maybe.update(set(self._house.of_kind("spot")) - {spot})
            else:
                maybe.discard(spot)

    def felt(self, state: State) -> None:
        """What the hand holds: a thing that it has put down is where the robot is."""
        if self._held and self._held != state.holding:
            self._at[self._held] = state.site
        if state.holding:
            self._at.pop(state.holding, None)
            self._maybe[state.holding].clear()
        self._held = state.holding

    def facts(self, state: State) -> FrozenSet[Fact]:
        """All facts of sensed predicates."""
        return frozenset(self._facts(state))

    def _facts(self, state: State) -> Iterator[Fact]:
        yield ("robot_at", state.site or ANYWHERE)
        yield ("holding", state.holding) if state.holding else ("hand_empty",)
        yield from (("is_open", name) for name in state.open)
        yield from (("accessible", room) for room in accessible(self._house, state))
        yield from (("is_at", thing, spot) for thing, spot in self._at.items() if spot)
        yield from (("maybe_at", thing, spot) for thing, maybe in self._maybe.items() for spot in maybe)

    def values(self, state: State) -> Values:
        """All values of sensed functions that change: the battery, and the drives of a robot at no site."""
        ways = self._house.ways((state.x, state.y), (state.room,))
        return {("battery",): round(state.battery, 2), **_drives(self._house, ANYWHERE, ways)}


def _drives(house: House, start: str, ways: Dict[str, float]) -> Values:
    found: Values = {}
    for site, length in ways.items():
        if site != start:
            found["drive_use", start, site] = round(house.uses.get("navigate", 0.0) * length, 2)
            found["drive_cost", start, site] = round(COST * house.tries("navigate") + METRE_COST * length)
    return found


def fixed_facts(house: House) -> List[Fact]:
    """What does not change."""
    found: List[Fact] = []
    for name, site in house.sites.items():
        found += [("in_room", name, room) for room in site.rooms]
        if site.kind == "door":
            found += [("joins", name, *site.rooms), ("joins", name, *reversed(site.rooms))]
    return found


def fixed_values(house: House) -> Values:
    """What does not change of the functions: drives between sites, reserves, costs."""
    chargers = house.of_kind("charger")
    found: Values = {
        ("work_use",): max([use for action, use in house.uses.items() if action != "navigate"], default=0.0),
        ("hand_cost",): round(COST * max(house.tries("pick"), house.tries("place"))),
        ("lid_cost",): round(COST * max(house.tries("open"), house.tries("close"))),
        ("look_cost",): round(COST * house.tries("detect")),
    }
    for name, site in house.sites.items():
        ways = house.ways((site.x, site.y), site.rooms)
        found.update(_drives(house, name, ways))
        nearest = min([ways[charger] for charger in chargers if charger in ways], default=0.0)
        use = house.uses.get("navigate", 0.0)
        found["reserve", name] = 0.0 if site.kind == "charger" else round(use * nearest, 2)
    return found


def objects(house: House, things: Collection[str]) -> Dict[str, List[str]]:
    """Type of the domain → its objects."""
    kinds = {kind: house.of_kind(kind) for kind in ("spot", "door", "charger")}
    return {"room": list(house.rooms), "thing": sorted(things), **kinds}

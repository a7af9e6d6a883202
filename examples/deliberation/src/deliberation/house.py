# SPDX-License-Identifier: Apache-2.0
"""The house of a simulation: what stands where, what is open, what a drive costs. Without ROS."""

import math
from typing import Any, Dict, FrozenSet, Iterable, List, Mapping, NamedTuple, Set, Tuple

#: What a pyrobosim robot can do.
ACTIONS = ("navigate", "pick", "place", "open", "close", "detect")
ANYWHERE = "anywhere"
DETOUR = 1.3  # of a driven way over the straight lines through the doors
MARGIN = 1.0  # m of each drive


class Site(NamedTuple):
    """Where a robot can go: a spot for things, a door, or a charger."""

    kind: str
    """spot, door or charger."""
    rooms: Tuple[str, ...]
    """The room that it is in; both rooms of a door."""
    x: float
    """m, frame of the world."""
    y: float


class House(NamedTuple):
    """What does not change."""

    rooms: Tuple[str, ...]
    sites: Dict[str, Site]
    chances: Dict[str, float]
    """Action → the chance that it succeeds, 0 to 1."""
    uses: Dict[str, float]
    """Action → what it takes from the battery, per cent; navigate: per m."""

    def of_kind(self, kind: str) -> List[str]:
        """The names of the sites of a kind, sorted."""
        return sorted(name for name, site in self.sites.items() if site.kind == kind)

    def tries(self, action: str) -> float:
        """How often an action is expected to be tried until it succeeds."""
        return 1.0 / max(self.chances.get(action, 1.0), 1e-3)

    def ways(self, start: Tuple[float, float], rooms: Tuple[str, ...]) -> Dict[str, float]:
        """What a drive from a point to each site is expected to take, m, through doors as if all were open.

        :param start: m.
        :param rooms: those of the point.
        """
        lengths: Dict[str, float] = {}
        left = {
            name: math.dist(start, (site.x, site.y))
            for name, site in self.sites.items()
            if set(site.rooms) & set(rooms)
        }
        while left:
            name = min(left, key=lambda each: (left[each], each))
            length = lengths[name] = left.pop(name)
            site = self.sites[name]
            for other, next_site in self.sites.items() if site.kind == "door" else ():
                if other not in lengths and set(site.rooms) & set(next_site.rooms):
                    onwards = length + math.dist((site.x, site.y), (next_site.x, next_site.y))
                    left[other] = min(onwards, left.get(other, math.inf))
        return {name: DETOUR * length + MARGIN for name, length in lengths.items()}


class State(NamedTuple):
    """What a simulation is in, truly."""

    site: str
    """Where the robot is; empty: at no site."""
    room: str
    x: float
    """m, frame of the world."""
    y: float
    holding: str
    """The thing in its hand; empty: none."""
    battery: float
    """Per cent."""
    open: FrozenSet[str]
    things: Dict[str, str]
    """Thing → the spot where it is; empty: in the hand."""


#: A state of which nothing is known.
NOWHERE = State("", "", 0.0, 0.0, "", 0.0, frozenset(), {})


def accessible(house: House, state: State) -> FrozenSet[str]:
    """The rooms to which no closed door bars the robot's way."""
    found: Set[str] = set()
    news = {state.room} - {""}
    while news:
        found |= news
        doors = (house.sites[name] for name in house.of_kind("door") if name in state.open)
        news = {room for door in doors if set(door.rooms) & found for room in door.rooms} - found
    return frozenset(found)


def holds(goal: Tuple[str, ...], state: State) -> bool:
    """Whether a goal, `is_at thing spot` or `is_open site`, is true in a simulation.

    :param goal: its words; `not` before them makes it negative.
    :raises ValueError: for another one.
    """
    if goal[:1] == ("not",):
        return not holds(goal[1:], state)
    if goal[:1] == ("is_at",) and len(goal) == 3:
        return state.things.get(goal[1]) == goal[2]
    if goal[:1] == ("is_open",) and len(goal) == 2:
        return goal[1] in state.open
    raise ValueError(
        f"the goal {' '.join(goal)!r} is none that can be compared with the simulation; "
        "write (is_at thing spot), (is_open spot) or (not (is_open spot))"
    )


def words(goals: str) -> List[Tuple[str, ...]]:
    """The goals of a text, `(is_at mug table) (not (is_open fridge))`, as their words.

    :raises ValueError: for an empty text, or a goal that :func:`holds` cannot judge.
    """
    found, depth, goal = [], 0, ""
    for sign in goals.lower():
        depth += {"(": 1, ")": -1}.get(sign, 0)
        goal += " " if sign in "()" else sign
        if depth == 0 and goal.strip():
            found.append(tuple(goal.split()))
            goal = ""
    if not found or depth:
        raise ValueError(f"{goals!r} is not a list of goals; write (is_at mug table) (not (is_open fridge))")
    for each in found:
        holds(each, NOWHERE)
    return found


def mistake_in(goals: Iterable[Tuple[str, ...]], house: House, state: State) -> str:
    """Which goal names what is not in a house, as a sentence; empty: each can be reached or not.

    :param goals: as of :func:`words`.
    """
    places = sorted(house.sites)
    for goal in goals:
        predicate, *names = goal[1:] if goal[0] == "not" else goal
        there = [sorted(state.things), places] if predicate == "is_at" else [places]
        for name, known in zip(names, there):
            if name not in known:
                return (
                    f"the goal {' '.join(goal)!r} names {name}, which is not in this world; "
                    f"there are {', '.join(known)}"
                )
    return ""


def as_data(house: House, state: State) -> Dict[str, Any]:
    """Both as values of JSON."""
    sites = {name: site._asdict() for name, site in house.sites.items()}
    return {
        "house": {**house._asdict(), "sites": sites},
        "state": {**state._asdict(), "open": sorted(state.open)},
    }


def from_data(data: Mapping[str, Any]) -> Tuple[House, State]:
    """Both from values of JSON."""
    house, state = data["house"], data["state"]
    sites = {name: Site(**{**site, "rooms": tuple(site["rooms"])}) for name, site in house["sites"].items()}
    return (
        House(**{**house, "rooms": tuple(house["rooms"]), "sites": sites}),
        State(**{**state, "open": frozenset(state["open"])}),
    )

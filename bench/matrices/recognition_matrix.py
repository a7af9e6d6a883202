# SPDX-License-Identifier: Apache-2.0
"""The matrix of recognition: how often each class is seen over distances and angles, and how far off.

See docs/simulation.md.
"""

import argparse
import math
import statistics
from dataclasses import dataclass
from typing import Dict, Iterator, List, Optional, Tuple

from matrices.recognition_trial import Look, Placed, look
from matrices.trial import trials
from merlin_reactive.recognition.object_classes import OBJECT_CLASSES, PERSON
from merlin_reactive.recognition.object_recognizer import ObjectRecognizer
from merlin_reactive.seeded_random import draw

DISTANCES = (0.8, 1.2, 1.6, 2.0, 2.5, 3.0)  # m
PERSON_DISTANCES = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0)  # m
BEARINGS = (-24.0, -8.0, 8.0, 24.0)  # degrees
FACINGS = (0.0, 30.0, 50.0)  # degrees
SUPPORTS = {"table, 0.75 m": 0.75, "bar, 1.10 m": 1.1}


@dataclass
class Tally:
    """Looks at things of one kind."""

    shown: int = 0
    errors: Optional[List[float]] = None  # m, of those that were seen
    scores: Optional[List[float]] = None

    def add(self, done: Look, thing: Placed) -> None:
        """Counts one thing of a look."""
        self.errors, self.scores = self.errors or [], self.scores or []
        self.shown += 1
        sighting = done.seen[thing]
        if sighting is not None:
            self.errors.append(done.errors[thing])
            self.scores.append(sighting.score)

    def row(self) -> str:
        """Seen of shown, error, score, for a table."""
        errors = self.errors or []
        if not errors:
            return f"0/{self.shown} | | | "
        return (
            f"{len(errors)}/{self.shown} | {100 * statistics.median(errors):.1f} | {100 * max(errors):.1f} "
            f"| {min(self.scores or [0.0]):.2f}"
        )


def looks(seeds: int) -> Iterator[Tuple[str, float, List[Placed], Dict[str, object]]]:
    """The pictures to take: group, distance, what is in it, and how the room is."""
    kinds = list(OBJECT_CLASSES)
    for seed in range(1, seeds + 1):
        for distance in DISTANCES:
            for group, support in SUPPORTS.items():
                for first in range(0, len(kinds), len(BEARINGS)):
                    yield (
                        group,
                        distance,
                        _spread(kinds[first : first + len(BEARINGS)], distance, seed + first),
                        {"support": support, "seed": seed},
                    )
            signs = [f"tag_{7 + index}" for index in range(len(FACINGS))]
            yield "tag", distance, _spread(signs, distance, seed, FACINGS), {"seed": seed}
            for things in _hiding(distance, seed):
                yield "half hidden", distance, things, {"seed": seed}
        for distance in PERSON_DISTANCES:
            for group, table in (("person behind a table", True), ("person", False)):
                people = _spread([PERSON] * (2 if distance > 1.2 else 1), distance, seed)
                yield group, distance, people, {"table": table, "seed": seed}


def main(arguments: Optional[List[str]] = None) -> int:
    """Prints the table; returns 1 when a class is missed that should be seen."""
    parser = argparse.ArgumentParser(prog="bench/matrices recognition", description=__doc__)
    parser.add_argument("--seeds", type=trials, default=2, help="pictures per case (default 2)")
    options = parser.parse_args(arguments)
    by_class: Dict[str, Tally] = {}
    by_distance: Dict[Tuple[str, float], Tally] = {}
    false: List[str] = []
    pictures = 0
    recognizer = ObjectRecognizer()
    for group, distance, things, room in looks(options.seeds):
        done = look(things, recognizer=recognizer, **room)  # type: ignore[arg-type]
        pictures += 1
        for thing in things:
            name = group if group.startswith(("person", "half")) else thing.kind
            if thing.kind.startswith("tag"):
                name = f"tag turned by {math.degrees(thing.facing):.0f}°"
            if distance <= 2.5 or group.startswith("person"):
                by_class.setdefault(name, Tally()).add(done, thing)
            by_distance.setdefault((group, distance), Tally()).add(done, thing)
        false += [
            f"{group}, {distance} m: {sighting.name} {sighting.score:.2f} at {sighting.position}"
            for sighting in done.false
        ]
    header = "| seen | error, cm (median) | error, cm (worst) | score (least) |"
    print(f"{pictures} pictures, {len(false)} false positives\n")
    print(f"| class, 0.8 to 2.5 m (people 1 to 5 m) {header}\n|---|---|---|---|---|")
    for name, tally in by_class.items():
        print(f"| {name} | {tally.row()} |")
    print(f"\n| where | distance, m {header}\n|---|---|---|---|---|---|")
    for (group, distance), tally in sorted(by_distance.items()):
        print(f"| {group} | {distance:.1f} | {tally.row()} |")
    for line in false:
        print(f"false: {line}")
    return 1 if false or any(len(tally.errors or []) < tally.shown for tally in by_class.values()) else 0


def _hiding(distance: float, seed: int) -> List[List[Placed]]:
    """Things of which the nearer one hides a part of the other."""
    turn = float(draw(seed, "recognition hiding", round(100 * distance)).uniform(-0.2, 0.2))
    return [
        [Placed(kind, distance, turn), Placed(kind, distance + 0.2, turn + 0.05 / distance)]
        for kind in ("cup", "water", "bottle")
    ] + [[Placed("bottle", distance - 0.2, turn + 0.02), Placed("plate", distance, turn)]]


def _spread(kinds: List[str], distance: float, seed: int, facings: Tuple[float, ...] = ()) -> List[Placed]:
    """Things side by side, a little off from where the table of cases has them."""
    random = draw(seed, "recognition", round(100 * distance))
    order = random.permutation(len(BEARINGS))
    things = []
    for index, kind in enumerate(kinds):
        bearing = BEARINGS[order[index]]
        if kind == PERSON:
            # Far enough from each other that neither hides the other.
            bearing = (-17.0, 17.0)[index]
        shift, turn, near = random.uniform(-1.0, 1.0, 3)
        facing = facings[index] if facings else 45.0 * turn
        things.append(
            Placed(kind, distance + 0.03 * near, math.radians(bearing + 3.0 * shift), math.radians(facing))
        )
    return things

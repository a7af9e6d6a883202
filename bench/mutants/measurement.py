# SPDX-License-Identifier: Apache-2.0
"""Mutants of several modules, one after the other, and the table of what became of them."""

import argparse
import csv
import sys
import time
from fnmatch import fnmatch
from pathlib import Path
from typing import Dict, Iterable, Iterator, List, Sequence, Tuple

from mutants.changes import Mutant, mutants
from mutants.importers import Imports
from mutants.trial import SURVIVED, UNTESTED, Bench


class Table:
    """What became of the mutants, module by module."""

    def __init__(self, modules: Iterable[Path], root: Path) -> None:
        self._root = root
        self.ends: Dict[Path, List[Tuple[Mutant, str, float]]] = {module: [] for module in modules}

    def survivors(self) -> List[Mutant]:
        """All that no test noticed."""
        return [mutant for ends in self.ends.values() for mutant, end, _ in ends if _passed(end)]

    def lines(self) -> Iterator[str]:
        """The table in Markdown, those that let most survive first, and the survivors."""
        yield "| module | mutants | killed | survived | share that survives |"
        yield "|---|---|---|---|---|"
        counted = {
            shown(module, self._root): [end for _, end, _ in ends] for module, ends in self.ends.items()
        }
        rows = [(_share(ends), name, ends) for name, ends in counted.items() if ends]
        every = [end for _, _, ends in rows for end in ends]
        rows.sort(key=lambda row: (-row[0], row[1]))
        for share, name, ends in [*rows, (_share(every), "all", every)]:
            survived = sum(map(_passed, ends))
            yield f"| {name} | {len(ends)} | {len(ends) - survived} | {survived} | {share:.0%} |"
        for mutant in self.survivors():
            yield f"{shown(mutant.module, self._root)}:{mutant.line}: {mutant.before}  ->  {mutant.after}"

    def write(self, target: Path) -> None:
        """Writes all mutants as CSV."""
        target.parent.mkdir(parents=True, exist_ok=True)
        with target.open("w", newline="", encoding="utf-8") as file:
            rows = csv.writer(file)
            rows.writerow(["module", "line", "before", "after", "end", "seconds"])
            for module, ends in self.ends.items():
                for mutant, end, seconds in ends:
                    place = [shown(module, self._root), mutant.line]
                    rows.writerow([*place, mutant.before, mutant.after, end, f"{seconds:.1f}"])


def _share(ends: Sequence[str]) -> float:
    return sum(map(_passed, ends)) / len(ends) if ends else 0.0


def _passed(end: str) -> bool:
    return end in (SURVIVED, UNTESTED)


def shown(module: Path, root: Path) -> str:
    """A module as it is named on the command line and in tables."""
    return "/".join(module.relative_to(root).parts[3:])


def measure(
    modules: Sequence[Path], table: Table, bench: Bench, options: argparse.Namespace, root: Path
) -> None:
    """Runs mutant after mutant; one of each module before the second of any, so that an early end is fair.

    :param options: `sample`, `seed`, `seconds` of tests per mutant, `minutes` in all or 0.
    """
    imports, begin, done = Imports(root), time.monotonic(), 0
    drawn = {module: mutants(module, options.sample, options.seed, root) for module in modules}
    total = sum(map(len, drawn.values()))
    for turn in range(options.sample):
        for module in modules:
            if turn >= len(drawn[module]):
                continue
            if options.minutes and time.monotonic() - begin > 60.0 * options.minutes:
                print(f"ended after {options.minutes:g} min, with {done} of {total} mutants", file=sys.stderr)
                return
            mutant = drawn[module][turn]
            tests = bench.chosen(imports.tests_of(module), options.seconds)
            end, seconds = bench.run(mutant, tests) if tests else (UNTESTED, 0.0)
            table.ends[module].append((mutant, end, seconds))
            done += 1
            left = (time.monotonic() - begin) / done * (total - done) / 60.0
            place = f"{module.relative_to(root)}:{mutant.line}"
            print(f"{done}/{total} {place} {end}, about {left:.0f} min left", file=sys.stderr, flush=True)


def selected(patterns: Sequence[str], root: Path) -> List[Path]:
    """The modules that match; packages themselves are left out."""
    paths = [path for home in ("src", "extras") for path in sorted(root.glob(f"{home}/*/src/**/*.py"))]
    paths = [path for path in paths if path.name != "__init__.py"]
    return [path for path in paths if any(fnmatch(shown(path, root), pattern) for pattern in patterns)]

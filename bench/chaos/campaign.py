# SPDX-License-Identifier: Apache-2.0
"""Runs trials one after the other, on one running system while it is healthy, and writes what they showed."""

import json
import time
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Dict, Iterator, List, Optional, TextIO, Tuple

from chaos import table
from chaos.judging import events
from chaos.judging.evidence import PATIENCE
from chaos.judging.why_rules import names_it
from chaos.result import Result
from chaos.runner import Runner
from chaos.striking.kinds import why_not
from chaos.trials import Trial, known_failures
from chaos.under_test.system import StartError, System

#: How often in a row a system may fail to come up.
STARTS = 2
#: Trials that are looked at together, so that those of one variant share a system.
BATCH = 24


class Campaign:
    """A series of trials.

    :param results: file that takes a row per trial.
    :param points: x, y of the points of interest.
    :param out: takes a line per trial.
    :param reuse: use a healthy system for the next trial.
    :param patience: see :class:`.evidence.Evidence`.
    :param why: ask the robot why, after each trial in which a request failed; needs a history, so a monitor.
    """

    def __init__(
        self,
        results: Path,
        points: Dict[str, Tuple[float, float]],
        out: TextIO,
        reuse: bool = True,
        patience: float = PATIENCE,
        why: bool = False,
    ) -> None:
        self._why = why
        self._patience = patience
        self._results = results
        self._points = points
        self._out = out
        self._reuse = reuse
        self._system: Optional[System] = None
        self._runner: Optional[Runner] = None
        self._unstarted: List[str] = []
        self.rows: List[Dict[str, str]] = []

    def run(self, trials: Iterator[Trial], count: Optional[int], seconds: Optional[float]) -> int:
        """Runs trials until there are enough, or the time is over; returns how many had violations.

        A trial that did not come to its moment does not count. A known failure is tried again, and another
        trial takes the place of any other one.

        :raises StartError: the system never came up.
        """
        end = None if seconds is None else time.monotonic() + seconds
        valid = attempts = 0
        again: Optional[Trial] = None
        ordered = _batches(trials, BATCH if count is None else max(1, min(BATCH, count)))
        try:
            while count is None or valid < count:
                if end is not None and time.monotonic() >= end:
                    break
                if count is not None and attempts >= 2 * count + 5:
                    self._say("too many trials were not valid; giving up")
                    break
                trial = again or next(ordered, None)
                if trial is None:
                    break
                if self._why:
                    # What its client takes back does not fail.
                    trial = replace(trial, cancel=False, variant=replace(trial.variant, page=True))
                attempts += 1
                counts = self._one(attempts, trial)
                valid += counts
                tries = not counts and trial.name in known_failures() and not why_not(trial.fault)
                again = (
                    replace(trial, seed=trial.seed + 1) if tries else None
                )  # at another time of its moment
        finally:
            self.stop()
        if self._unstarted and not self.rows:
            raise StartError(self._unstarted[-1])
        return sum(bool(fields["violations"]) for fields in self.rows)

    def stop(self, keep: bool = False) -> None:
        """Ends the system that runs, if any.

        :param keep: the folder of its logs.
        """
        if self._system is not None:
            self._system.stop(keep)
            self._system = None

    def _one(self, number: int, trial: Trial) -> bool:
        if why_not(trial.fault):
            self._say(f"{number:3} {trial.label}: left out, {why_not(trial.fault)}")
            return False
        begin = time.monotonic()
        try:
            fresh = self._ready(trial)
        except StartError as error:
            self._say(f"{number:3} {trial.label}: the system does not start: {error}")
            self._unstarted.append(str(error))
            return False
        assert self._runner is not None and self._system is not None
        result = self._runner.run(trial)
        fields = table.row(number, result, fresh, named(result))
        self.rows.append(fields)
        table.append(self._results, fields)
        self._tell(number, result, time.monotonic() - begin)
        # Clocks that were set stay so.
        used_up = not self._reuse or trial.variant.shuffled or trial.variant.time == "set"
        if not result.clean or used_up or self._system.missing_nodes():
            logs, bad = self._system.logs, not result.clean
            self.stop(keep=bad)
            if bad:
                _write_events(logs / "events.jsonl", result)
                self._say(f"      logs and events: {logs}")
        return result.judgement is not None

    def _ready(self, trial: Trial) -> bool:
        """Has a system of the trial's variant; True when it was started for it."""
        if self._system is not None and self._system.variant == trial.variant:
            return False
        self.stop()
        for attempt in range(STARTS):
            system = self._system = System(trial.variant, trial.seed % 1000 + 1)
            try:
                system.start()
                break
            except StartError as error:
                self.stop(keep=True)
                if attempt + 1 == STARTS:
                    raise
                self._say(f"      the system did not start: {error}; again")
        self._runner = Runner(system, self._points, self._patience, self._why)
        return True

    def _tell(self, number: int, result: Result, seconds: float) -> None:
        judgement = result.judgement
        if judgement is None:
            self._say(f"{number:3} {result.trial.label}: {result.note} ({seconds:.0f} s)")
            return
        figures = ", ".join(
            f"{name} {value:.2f} s"
            for name, value in (
                ("stands", judgement.stand),
                ("told", judgement.answer),
                ("next", judgement.following),
                ("stop", judgement.stopping),
            )
            if value is not None
        )
        verdict = f"{len(judgement.violations)} VIOLATIONS" if judgement.violations else "good"
        reported = f"{judgement.outcome or '-'}; {figures}"
        self._say(f"{number:3} {result.trial.label}: {verdict} [{reported}] ({seconds:.0f} s)")
        for violation in judgement.violations:
            self._say(f"      {violation}")
        for ended in (event for event in result.log if event.kind == events.ENDED and judgement.violations):
            self._say(f"      told: {ended['label']} {ended['outcome']}: {ended['reason'][:200]}")
        for event in (event for event in result.log if event.kind == events.WHY):
            said = "names it" if named(result) else "DOES NOT NAME IT"
            self._say(f"      why: {event['sentence'] or event['error']} ({said})")
        if result.note:
            self._say(f"      {result.note}")

    def _say(self, line: str) -> None:
        self._out.write(line + "\n")
        self._out.flush()


def named(result: Result) -> Optional[bool]:
    """Whether the robot named what was broken, when it was asked why; None: it was not asked."""
    reported = [event["sentence"] for event in result.log if event.kind == events.WHY]
    return names_it(result.trial.fault, reported[-1]) if reported else None


def _write_events(path: Path, result: Result) -> None:
    """What the witness saw, a line of JSON per event."""
    with path.open("w") as file:
        for event in result.log:
            file.write(json.dumps({"at": event.at, "kind": event.kind, **event.data}) + "\n")


def _batches(trials: Iterator[Trial], size: int) -> Iterator[Trial]:
    """The trials, those of one variant together within a batch."""
    while True:
        batch = list(islice(trials, size))
        if not batch:
            return
        variants = list(dict.fromkeys(trial.variant for trial in batch))
        for variant in variants:
            yield from (trial for trial in batch if trial.variant == variant)

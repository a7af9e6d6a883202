# SPDX-License-Identifier: Apache-2.0
"""The past as the monitor's history has it: what was so, what happened, and who changed a fact."""

import json
import math
import time
from pathlib import Path
from typing import Any, Dict, Iterator, List, Optional, Sequence, Tuple

from merlin_explain.claims import QuestionError
from merlin_explain.execution.moment import Change, Moment, key_of
from merlin_monitor.history.event_log import MARKS, EventLog, Neighbour
from merlin_monitor.history.frames import Recording
from merlin_monitor.history.history_file import HistoryError, last_run, open_for_reading
from merlin_monitor.state.state_tree import apply_changes
from merlin_pddl.domain import Domain
from merlin_ros.work.passed_time import clock_text

#: An event as the history has it: kind, text, at (ROS time, s), mark and detail.
Event = Dict[str, Any]
MOST_EVENTS = 1000  # that a question looks at
LOOK_BACK = 2.0  # s of wall time for the search of a change
KEPT = 3  # segments that are held besides the last one that was read: one has 1 MB
PANEL = "why"  # section of the panel that this package offers
DAY = 86400.0  # s
LATER = 0.5  # s in which the monitor notes what has happened


class RecordedPast:
    """A run of a history, up to a moment. For one thread; to be closed.

    :param path: of the file, or of its folder.
    :param at: the moment, ROS time, s; 0: the last that is recorded.
    :param session: of the monitor that goes on with the run; empty: any.
    :param run: its number; 0: the newest one.
    :raises HistoryError: the file is missing or cannot be used.
    :raises QuestionError: there is no such run, or it has no such moment.
    """

    def __init__(self, path: Path, domain: Domain, at: float = 0.0, session: str = "", run: int = 0) -> None:
        self._domain = domain
        self._connection = open_for_reading(path)
        self._recording = Recording(self._connection)
        self._segments: List[Dict[str, Any]] = []
        try:
            present = last_run(self._connection, None, session)
            if session and present is None:
                raise HistoryError(
                    f"the monitor has recorded nothing into {path} in this run; is it running?"
                )
            runs = {int(each["run"]): each for each in self._recording.runs()}
            number = run or (present.run if present else max(runs))
            if number not in runs:
                raise QuestionError(f"there is no run {number}; there are: {', '.join(map(str, runs))}")
            self._run = runs[number]
            self._wall = self._wall_of(at) if at else float(self._run["ended"])
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Closes the file."""
        self._connection.close()

    def age(self, moment: Moment, ticks: float, wall: float) -> float:
        """How long ago the moment was recorded, s.

        The monitor's time is even when the computer's clock is set, and its panel says how it counts.

        :param moment: the last one.
        :param ticks: s of ``time.monotonic``.
        :param wall: s since 1970, for a recording without this panel.
        """
        even = moment.section(PANEL).get("clock")
        return abs((wall if even is None else ticks + even) - self._wall)

    def moment(self) -> Moment:
        """What was so at the moment."""
        return self._shown(self._wall)

    def failures(self, kinds: Sequence[str]) -> Iterator[Event]:
        """The events of these kinds that are marked, newest first."""
        last = Neighbour(int(self._run["run"]), self._wall + LATER, 0, False, tuple(kinds), MARKS)
        for _ in range(MOST_EVENTS):
            event = EventLog(self._connection).neighbour(last)
            if event is None:
                return
            yield event
            last = last._replace(identity=event["id"])

    def events(self, kinds: Sequence[str], until: float) -> List[Event]:
        """The newest events of these kinds, oldest first.

        :param until: s since 1970.
        """
        log, run = EventLog(self._connection), int(self._run["run"])
        last = log.neighbour(Neighbour(run, min(until, self._wall) + LATER, forward=False))
        found = log.page(last["id"] + 1, MOST_EVENTS, list(kinds)) if last else []
        return [event for event in found if event["run"] == run]

    def after(self, event: Event) -> Moment:
        """What was so when an event had been noted: it is in a frame of its time, or a later one."""
        return self._shown(event["wall"], after=True)

    def at(self, at: float) -> Optional[Moment]:
        """What was so at a ROS time, s; None: not known."""
        try:
            return self._shown(self._wall_of(at))
        except QuestionError:
            return None

    def change(self, text: str, at: float = math.inf) -> Optional[Change]:
        """The last change of a fact or value; None: none is found.

        :param at: up to which, ROS time, s.
        """
        wanted = key_of(text)
        for found in self._changes_back(json.dumps(" ".join(wanted))[1:-1]):
            name = str(found.get("key") or found["text"])
            if key_of(name) == wanted and found["kind"] in ("facts", "values") and found["at"] <= at:
                version = int(found.get("version") or 0)
                return Change(found["sign"], name, found["by"], float(found["at"]), version)
        return None

    def _changes_back(self, text: str) -> Iterator[Dict[str, Any]]:
        """The recorded changes of knowledge, newest first, of the segments in which a text stands."""
        ends = time.monotonic() + LOOK_BACK
        until = self._wall
        while until >= self._run["began"] and time.monotonic() < ends:
            raw = self._text(until)
            if text in raw.lower():
                yield from _changes_of(json.loads(raw)["frames"], self._wall)
            until = json.loads(raw.partition(',"frames"')[0] + "}")["began"] - 0.001

    def _shown(self, wall: float, after: bool = False) -> Moment:
        """What was so at a time, s since 1970.

        :param after: in the first frame that is not before it.
        """
        segment = self._segment(wall)
        if after and segment["next"] is not None and segment["frames"][-1][0] < wall:
            segment = self._segment(segment["next"])
        (seen, _, whole, _), *later = segment["frames"]
        state: Dict[str, Any] = dict(whole)
        own: Dict[int, Any] = {}
        for frame_wall, _, changes, _ in later:
            if seen >= wall if after else frame_wall > wall:
                break
            apply_changes(state, changes, own)
            seen = frame_wall
        return Moment(state, self._domain)

    def _wall_of(self, at: float) -> float:
        """When a ROS time was, s since 1970: of the last frame that is not later."""
        low, high = float(self._run["began"]), float(self._run["ended"])
        begin, end = self.span()
        if not begin - LATER <= at <= end + LATER:
            asked = time.strftime("%Y-%m-%d ", time.localtime(at)) if abs(end - at) > DAY and at > DAY else ""
            of = f"{clock_text(begin)} to {clock_text(end)}"
            raise QuestionError(f"the recording is of {of}, and has no {asked}{clock_text(at)}")
        # A robot's ROS time is nearly that of the computer.
        middle = at if low <= at <= high else (low + high) / 2
        while True:
            frames = self._segment(middle)["frames"]
            if frames[0][1] > at and frames[0][0] > low:
                high = frames[0][0] - 0.001
            elif frames[-1][1] < at and frames[-1][0] < high and high - low > LATER:
                low = max(frames[-1][0], middle)
            else:
                seen = max((frame[1] for frame in frames if frame[1] <= at), default=frames[0][1])
                walls = [float(frame[0]) for frame in frames if frame[1] == seen]
                # A frame has the time that was shown, which is renewed a few times per s.
                return max(wall for wall in walls if wall - walls[0] <= max(0.0, at - seen))
            middle = (low + high) / 2

    def span(self) -> Tuple[float, float]:
        """ROS time of the first and of the last frame, s."""
        first, last = (self._segment(float(self._run[name]))["frames"] for name in ("began", "ended"))
        return next((at for _, at, _, _ in first if at), 0.0), last[-1][1]  # before, no clock was heard

    def _segment(self, wall: float) -> Dict[str, Any]:
        """The segment of a time, s since 1970; it is not changed."""
        for known in self._segments:
            if known["began"] <= wall < (known["next"] or math.inf):
                return known
        found: Dict[str, Any] = json.loads(self._text(wall))
        self._segments = [*self._segments[-KEPT:], found]
        return found

    def _text(self, wall: float) -> str:
        try:
            return self._recording.segment(int(self._run["run"]), wall) or ""
        except ValueError as error:
            raise HistoryError(str(error)) from error


def _changes_of(frames: List[Any], until: float) -> Iterator[Dict[str, Any]]:
    """The changes of knowledge in the frames of a segment, newest first."""
    (_, _, state, _), *later = frames
    for wall, _, changes, _ in reversed(later):
        for path, *value in reversed(changes) if wall <= until else ():
            if path[:2] == ["knowledge", "recent"] and len(path) == 3 and value:
                yield value[0]
    recent = (state.get("knowledge") or {}).get("recent") or {}
    yield from (recent[number] for number in sorted(recent, key=int, reverse=True))

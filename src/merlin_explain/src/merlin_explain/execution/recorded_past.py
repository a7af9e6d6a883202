# SPDX-License-Identifier: Apache-2.0
"""The past as the monitor's history has it: what was so, what happened, and who changed a fact."""

import json
import math
import time
from pathlib import Path
from typing import Any, Dict, Iterator, List, NamedTuple, Optional, Sequence, Tuple

from merlin_explain.claims import QuestionError
from merlin_explain.execution.moment import Change, Moment, key_of
from merlin_monitor.history.event_log import MARKS, EventLog, Neighbour
from merlin_monitor.history.frames import Recording
from merlin_monitor.history.history_file import HistoryError, last_run, open_for_reading
from merlin_monitor.state.knowledge_section import KINDS
from merlin_monitor.state.state_tree import apply_changes
from merlin_pddl.domain import Domain
from merlin_pddl.knowledge import Key
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

    Of a run in which simulated time was set back, what came after that.

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
            self._last = self._readable()
            # A simulator was begun anew: its time since then grows.
            back = (self._last["frames"][0][2].get("meta") or {}).get("set_back") or 0.0
            self._run["began"] = max(float(self._run["began"]), back)
            self._wall = self._wall_of(at) if at else self._last_wall()
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
        """The last change of a fact or value; None: there is none in the run.

        :param at: up to which, ROS time, s.
        :raises TimeoutError: none is found in `LOOK_BACK` s, and the begin of the run is not reached.
        """
        return next((change for change in self._changes_back(key_of(text)) if change.at <= at), None)

    def _changes_back(self, wanted: Key) -> Iterator[Change]:
        """The changes of a fact or value, newest first; of when it vanished also those that no list has."""
        ends = time.monotonic() + LOOK_BACK
        text = json.dumps(" ".join(wanted))[1:-1]
        until, behind = self._wall, 0.0  # s since 1970, of a later segment in which it does not stand
        gone: Optional[float] = None  # s of ROS time at which it had vanished, in which way is not known yet
        while until >= self._run["began"]:
            if time.monotonic() >= ends:
                raise TimeoutError("the search of the recording takes too long")
            raw = self._text(until)
            began = json.loads(raw.partition(',"frames"')[0] + "}")["began"]
            if text not in raw.lower():  # most segments: they are not read
                behind = until
            else:
                frames = json.loads(raw)["frames"]
                for seen in reversed(_seen(frames, wanted, self._wall)):
                    if seen.name and behind:
                        later = _seen(self._segment(behind)["frames"], wanted, self._wall)
                        gone = later[0].at if later else gone
                    if seen.name and gone is not None:
                        yield Change("-", seen.name, "", gone, after=seen.at)
                    behind, gone = 0.0, None if seen.name else seen.at
                    for change in reversed(seen.changes):
                        if not seen.name and gone is not None and change.sign != "-":
                            yield Change("-", change.text, "", gone, after=change.at)
                        gone = None
                        yield change
            until = began - 0.001

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
        low, high = float(self._run["began"]), self._last_wall()
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
        first, last = self._readable(oldest=True)["frames"], self._last["frames"]
        return next((at for _, at, _, _ in first if at), 0.0), last[-1][1]  # before, no clock was heard

    def _last_wall(self) -> float:
        """When the run ended, s since 1970, or what can be read of it."""
        return float(self._run["ended"] if self._last["next"] is None else self._last["frames"][-1][0])

    def _readable(self, oldest: bool = False) -> Dict[str, Any]:
        """The newest segment that can be read, or the oldest one; it is not changed."""
        since = float(self._run["began"]) if oldest else 0.0
        text = self._recording.readable(int(self._run["run"]), oldest, since)
        if text is None:
            raise HistoryError(f"nothing that was shown in run {self._run['run']} can be read")
        return self._keep(text)

    def _segment(self, wall: float) -> Dict[str, Any]:
        """The segment of a time, s since 1970; it is not changed."""
        for known in self._segments:
            if known["began"] <= wall < (known["next"] or math.inf):
                return known
        return self._keep(self._text(wall))

    def _keep(self, text: str) -> Dict[str, Any]:
        found: Dict[str, Any] = json.loads(text)
        self._segments = [*self._segments[-KEPT:], found]
        return found

    def _text(self, wall: float) -> str:
        try:
            return self._recording.segment(int(self._run["run"]), wall) or ""
        except ValueError as error:
            raise HistoryError(str(error)) from error


class _Seen(NamedTuple):
    """What a frame has of a fact or value.

    :ivar at: s of ROS time.
    :ivar name: as the knowledge has it; empty: it is not there.
    :ivar changes: that are noted in the frame, oldest first.
    """

    at: float
    name: str
    changes: List[Change]


def _seen(frames: List[Any], wanted: Key, until: float = math.inf) -> List[_Seen]:
    """What the frames of a segment have of a fact or value; without those before the knowledge was read.

    :param until: s since 1970.
    """
    (_, at, state, _), *later = frames
    knowledge = state.get("knowledge") or {}
    names = {kind: _name(knowledge.get(kind) or {}, wanted) for kind in ("facts", "values")}
    name = "".join(names.values())
    read = any(knowledge.get(each) for each in (*KINDS, "version"))
    noted = _noted(knowledge.get("recent") or {}, wanted)
    # The list goes back to before this segment, and does not have all changes.
    fits = bool(noted) and (noted[-1].sign != "-") == bool(name)
    found = [_Seen(at, name, noted if fits else [])] if read and at else []
    for wall, at, changes, _ in later:
        if wall > until:
            break
        recent = {}
        for (section, *path), *value in changes:
            if section != "knowledge" or not path:
                continue
            read = read or bool(path[0] in (*KINDS, "version") and value and value[0])
            if path[0] in names and len(path) == 1:
                names[path[0]] = _name(value[0] if value else {}, wanted)
            elif path[0] in names and key_of(path[1]) == wanted:
                names[path[0]] = path[1] if value else ""
            elif path[0] == "recent" and len(path) == 2 and value:
                recent[path[1]] = value[0]
        if read and at:
            found.append(_Seen(at, "".join(names.values()), _noted(recent, wanted)))
    return found


def _name(table: Dict[str, Any], wanted: Key) -> str:
    return next((name for name in table if key_of(name) == wanted), "")


def _noted(recent: Dict[str, Any], wanted: Key) -> List[Change]:
    """The noted changes of a fact or value, oldest first."""
    found = [recent[number] for number in sorted(recent, key=int)]
    names = [str(each.get("key") or each["text"]) for each in found]
    return [
        Change(each["sign"], name, each["by"], float(each["at"]), int(each.get("version") or 0))
        for each, name in zip(found, names)
        if each["kind"] in ("facts", "values") and key_of(name) == wanted
    ]

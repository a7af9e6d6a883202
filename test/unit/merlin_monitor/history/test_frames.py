# SPDX-License-Identifier: Apache-2.0
"""What was shown comes back: any changes, any moment; bounded, and readable after any end."""

import itertools
import json
import sqlite3
import time
from pathlib import Path
from typing import Any, Callable, Dict, List, Tuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from merlin_monitor.bag.bag_import import RecordedModel
from merlin_monitor.history.event_log import Neighbour
from merlin_monitor.history.frames import Frame, Recording
from merlin_monitor.history.history_file import VERSION, HistoryError
from merlin_monitor.history.history_reader import HistoryReader
from merlin_monitor.state import history_store
from merlin_monitor.state.history_events import Event
from merlin_monitor.state.history_store import HistoryStore
from merlin_monitor.state.state_tree import StateTree, apply_changes
from merlin_test import LONG

keys = st.sampled_from(["plan", "map", "a", "__proto__", "ü", "history"])
values = st.recursive(
    st.none() | st.booleans() | st.integers(-9, 9) | st.floats(allow_nan=True) | st.text(max_size=4),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(keys, inner, max_size=3),
    max_leaves=5,
)
changes = st.lists(st.tuples(st.lists(keys, min_size=1, max_size=3), st.none() | values), max_size=6)


class Recorded:
    """A tree of which each call makes a frame, in a real file."""

    def __init__(self, folder: Path, **options: Any) -> None:
        self.tree = StateTree(("plan", "map"))
        self.path = folder / "history.sqlite"
        self.store = HistoryStore(self.path, 100, **options)
        self.tick = 0.0
        self.meanwhile: Callable[[], Any] = lambda: None
        self.store.now = lambda: self.tick  # type: ignore[assignment, misc]
        self.store.follow(self.tree, live=False)
        self.states: List[Tuple[float, Dict[str, Any]]] = []

    def _clock(self) -> float:
        self.meanwhile()
        self.tick += 1.0
        return self.tick

    def frame(self) -> None:
        self.store.page(limit=1).result(LONG)  # what was added has the time of before
        before, self.store.now = self.store.now, self._clock  # type: ignore[assignment, misc]
        self.store.take()
        self.store.now = before  # type: ignore[misc]
        self.states.append((self.tick, shown(self.tree)))

    def reopened(self) -> HistoryReader:
        self.store.close()
        return HistoryReader.of(self.path)


def shown(tree: StateTree) -> Dict[str, Any]:
    state: Dict[str, Any] = json.loads(tree.as_json()[1])
    state.pop("history", None)
    return state


def state_at(reader: HistoryReader, run: int, wall: float) -> Dict[str, Any]:
    """What the page makes of the answer."""
    segment = json.loads(reader.segment(run, wall).result(LONG) or "null")
    assert segment["began"] <= wall and (segment["next"] is None or wall < segment["next"])
    state = segment["frames"][0][2]
    for at, _, changed, _ in segment["frames"][1:]:
        if at <= wall:
            apply_changes(state, changed)
    return state


@settings(max_examples=40, deadline=None)
@given(st.lists(changes, min_size=1, max_size=15), st.sampled_from([0, 40, 100_000]))
def test_any_moment_is_what_was_shown_then(
    tmp_path_factory: pytest.TempPathFactory, frames: List[Any], largest: int
) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(history_store, "LARGEST_SEGMENT", largest)
        recorded = Recorded(tmp_path_factory.mktemp("recorded"))
        for frame in frames:
            for path, value in frame:
                if value is None:
                    recorded.tree.remove(*path)
                else:
                    recorded.tree.set(*path, value)
            recorded.frame()
        run = recorded.store.run
        reader = recorded.reopened()
        for wall, state in recorded.states[::-1]:
            assert state_at(reader, run, wall) == state
            assert state_at(reader, run, wall + 0.5) == state
        assert state_at(reader, run, 1.0) == recorded.states[0][1]
        reader.close()


def test_an_event_leads_to_what_it_is_about_although_that_was_recorded_before_it(tmp_path: Path) -> None:
    clock = itertools.count(100.0)
    model = RecordedModel(tmp_path / "h", lambda: next(clock), print)
    model.start()
    for number in (1, 2):
        model.tree.set("now", "doing", number)
        model.record()  # a frame between a change and the report of it
        model.report(Event("action", f"doing {number}", 0.0))
        model.record()
    assert model.history is not None
    for event in model.history.export().result(LONG):
        frames = json.loads(model.history.segment(event["run"], 1e12).result(LONG) or "")["frames"]
        first = next(wall for wall, *_ in frames if wall >= event["wall"])
        assert f"doing {state_at(model.history, event['run'], first)['now']['doing']}" == event["text"]
    model.stop()


def test_an_event_has_never_the_time_of_a_frame_from_before_it(tmp_path: Path) -> None:
    tree = StateTree(("plan",))
    store = HistoryStore(tmp_path / "h", 1000)
    store.follow(tree, live=False)
    for number in range(100):
        tree.set("plan", "number", number)
        store.add(Event("plan", str(number), 0.0))
        store.take()
    for event in store.export().result(LONG):
        frames = json.loads(store.segment(store.run, 1e12).result(LONG) or "")["frames"]
        first = next(wall for wall, *_ in frames if wall >= event["wall"])
        assert state_at(store, store.run, first)["plan"]["number"] == int(event["text"])
    store.close()


def test_a_frame_has_all_that_was_changed_by_its_time(tmp_path: Path) -> None:
    recorded = Recorded(tmp_path)
    for number in range(3):
        # While a frame is taken, another thread changes something, before the time that the frame gets.
        recorded.meanwhile = lambda number=number: recorded.tree.set("plan", "number", number)
        recorded.frame()
        reader = recorded.store
        assert state_at(reader, reader.run, recorded.tick)["plan"]["number"] == number
    recorded.store.close()


def test_more_changes_than_a_feed_keeps_are_a_whole_state(tmp_path: Path) -> None:
    recorded = Recorded(tmp_path)
    recorded.frame()
    for number in range(3000):
        recorded.tree.set("plan", f"step {number}", number)
    recorded.frame()
    reader = recorded.reopened()
    assert state_at(reader, 1, 2.0) == recorded.states[1][1]
    reader.close()


def test_it_keeps_what_changes_by_itself_and_the_last_change_at_its_end(tmp_path: Path) -> None:
    tree = StateTree(("plan",))
    store = HistoryStore(tmp_path / "h", 100)
    for number in range(50):
        tree.set("plan", "number", number)
    store.follow(tree)
    until = time.monotonic() + LONG
    while not store.runs().result(LONG) and time.monotonic() < until:
        time.sleep(0.01)
    tree.set("plan", "number", "last")
    store.close()
    reader = HistoryReader.of(tmp_path / "h")
    (run,) = reader.runs().result(LONG)
    assert state_at(reader, run["run"], run["began"]) == {"plan": {"number": 49}}
    assert state_at(reader, run["run"], run["ended"]) == {"plan": {"number": "last"}}
    reader.close()


def test_the_file_stays_bounded_and_the_newest_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(history_store, "LARGEST_SEGMENT", 5_000)
    recorded = Recorded(tmp_path, megabytes=0.05)
    recorded.store.add_picture("map", "of all the time", b"map")
    for number in range(600):
        # Random enough not to be packed away.
        recorded.tree.set("plan", f"{number % 40}", f"{hash((number, 'salt')) ** 3}")
        if number % 100 == 0:
            recorded.store.add_picture("seen", f"picture {number}", bytes(5_000))
        recorded.frame()
    kept = recorded.store.runs().result(LONG)
    assert kept[0]["ended"] == 600.0 and kept[0]["began"] > 100.0
    assert kept[0]["bytes"] < 80_000
    assert recorded.store.picture("seen", "picture 0").result(LONG) is None
    assert recorded.store.picture("seen", "picture 500").result(LONG) == bytes(5_000)
    assert recorded.store.picture("map", "of all the time").result(LONG) == b"map"
    reader = recorded.reopened()
    wall, state = recorded.states[-1]
    assert state_at(reader, 1, wall) == state
    first = json.loads(reader.segment(1, 3.0).result(LONG) or "")
    assert first["began"] > 100.0, "before what is kept comes the first moment that is"
    reader.close()


def test_more_pictures_than_it_may_keep_leave_no_rest_that_grows(tmp_path: Path) -> None:
    limit = 50_000
    recorded = Recorded(tmp_path, megabytes=limit / history_store.MEGABYTE)
    looks = 0

    def look() -> None:
        nonlocal looks
        looks += 1
        recorded.store.add_picture("seen", f"look {looks}", bytes(10_000))
        recorded.tree.set("plan", "look", looks)
        recorded.frame()

    for _ in range(12):  # of one segment
        look()
    for _ in range(8):
        recorded.tick += history_store.LONGEST_SEGMENT
        look()
        look()
    found = [recorded.store.picture("seen", f"look {number + 1}").result(LONG) for number in range(looks)]
    assert found[-1] and 3 <= len(list(filter(None, found))) <= limit // 10_000 + 2
    first = json.loads(recorded.store.segment(1, 0.0).result(LONG) or "")["frames"][0][2]
    assert recorded.store.picture("seen", f"look {first['plan']['look']}").result(LONG)
    recorded.store.close()


def test_a_clock_that_went_back_takes_no_picture_from_a_run_that_is_kept(tmp_path: Path) -> None:
    def life(began: float, picture: str, segments: int) -> Recorded:
        recorded = Recorded(tmp_path, megabytes=0.1)
        recorded.tick = began
        recorded.store.add_picture("map", picture, bytes(5_000))
        recorded.tree.set("map", "version", picture)
        for number in range(segments):
            recorded.tree.set("plan", "step", f"{[hash((number, each)) for each in range(1_000)]}")
            recorded.tick += history_store.LONGEST_SEGMENT
            recorded.frame()
        return recorded

    began = 1.7e9
    life(began, "right clock", 25).store.close()
    second = life(0.0, "no clock", 2)
    runs = second.store.runs().result(LONG)
    assert [run["run"] for run in runs] == [1, 2] and runs[0]["began"] > began + 1_000.0
    for picture in ("right clock", "no clock"):
        assert second.store.picture("map", picture).result(LONG)
    second.store.close()
    third = life(1.0e4, "no clock either", 25)
    assert [run["run"] for run in third.store.runs().result(LONG)] == [3]
    assert third.store.picture("map", "right clock").result(LONG) is None
    assert third.store.picture("map", "no clock either").result(LONG)
    third.store.close()


def test_robots_that_share_a_file_keep_their_part_of_it_and_their_own_pictures(tmp_path: Path) -> None:
    robots = {name: Recorded(tmp_path, megabytes=0.1, session=f"master {name}") for name in ("/ann", "/bob")}
    for name, recorded in robots.items():
        recorded.store.add_picture("map", f"map of {name}", bytes(5_000))
        recorded.tree.set("map", "version", f"map of {name}")
    for number in range(25):
        for recorded in robots.values():
            recorded.tree.set("plan", "step", f"{[hash((number, each)) for each in range(500)]}")
            recorded.tick += history_store.LONGEST_SEGMENT
            recorded.frame()
    for name, recorded in robots.items():
        (run,) = recorded.store.runs().result(LONG)
        assert history_store.LONGEST_SEGMENT < run["began"] < recorded.tick, "a part is kept"
        state = state_at(recorded.store, run["run"], recorded.tick)
        assert recorded.store.picture("map", state["map"]["version"]).result(LONG), name
    for recorded in robots.values():
        recorded.store.close()


def test_a_lost_frame_makes_the_next_one_whole(tmp_path: Path) -> None:
    recorded = Recorded(tmp_path)
    recorded.frame()
    recorded.tree.set("plan", "step", 1)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Recording, "add", full)
        recorded.frame()
        recorded.store.page(limit=1).result(LONG)  # what came before is written
    assert recorded.store.trouble == "the disk is full"
    recorded.tree.set("plan", "step", 2)
    recorded.frame()
    reader = recorded.reopened()
    assert state_at(reader, 1, recorded.tick) == {"plan": {"step": 2}, "map": {}}
    reader.close()


def full(*_: Any) -> None:
    raise sqlite3.OperationalError("the disk is full")


def test_a_monitor_that_was_killed_leaves_all_until_then(tmp_path: Path) -> None:
    recorded = Recorded(tmp_path)
    for number in range(20):
        recorded.tree.set("plan", "step", number)
        recorded.frame()
    recorded.store.page().result(LONG)  # what came before is written
    reader = HistoryReader.of(recorded.path)  # the other one is still open, as it is after a SIGKILL
    for wall, state in recorded.states:
        assert state_at(reader, 1, wall) == state
    reader.close()
    recorded.store.close()


def test_what_was_kept_in_memory_moves_to_the_file(tmp_path: Path) -> None:
    folder = tmp_path / "results"
    folder.mkdir()
    earlier = Recorded(folder)
    earlier.frame()
    earlier.store.close()
    (folder / "history.sqlite").rename(tmp_path / "kept")
    folder.rmdir()
    recorded = Recorded(folder, make_folder=False)
    recorded.tree.set("plan", "step", 1)
    recorded.frame()
    recorded.store.add_picture("map", "p", b"png")
    recorded.store.page().result(LONG)
    folder.mkdir()
    (tmp_path / "kept").rename(folder / "history.sqlite")
    recorded.tree.set("plan", "step", 2)
    recorded.frame()
    reader = recorded.reopened()
    assert [run["run"] for run in reader.runs().result(LONG)] == [1, 2]
    assert [state_at(reader, 2, wall)["plan"]["step"] for wall in (1.0, 2.0)] == [1, 2]
    assert reader.picture("map", "p").result(LONG) == b"png"
    reader.close()


def test_events_are_found_from_each_other(tmp_path: Path) -> None:
    store = HistoryStore(tmp_path / "h", 1000)
    for number, mark in enumerate(["", "failure", "", "cancel", "failure"]):
        store.add(Event("plan" if number % 2 else "goal", str(number), 0.0, {}, mark))
    events = store.export().result(LONG)
    assert [mark for _, _, mark in store.marks(store.run).result(LONG)] == ["failure", "cancel", "failure"]

    def found(**wanted: Any) -> Any:
        event = store.neighbour(Neighbour(store.run, **{"wall": 0.0, **wanted})).result(LONG)
        return event and event["text"]

    assert found() == "0" and found(marks=("failure",)) == "1"
    assert found(identity=events[1]["id"], marks=("failure",)) == "4"
    assert found(identity=events[1]["id"], kinds=("goal",)) == "2"
    assert found(identity=events[1]["id"], forward=False) == "0"
    assert found(wall=1e12) is None and found(wall=1e12, forward=False, marks=("cancel",)) == "3"
    assert store.neighbour(Neighbour(99, 0.0)).result(LONG) is None
    store.close()


# --- files that are not such a history ----------------------------------------------------------------------


def test_a_missing_a_foreign_a_newer_and_an_older_file_are_named(tmp_path: Path) -> None:
    with pytest.raises(HistoryError, match="there is no history .*history.sqlite"):
        HistoryReader.of(tmp_path)
    text = tmp_path / "text"
    text.write_text("no database at all, but a text of some length to be taken for one " * 50)
    with pytest.raises(HistoryError, match="is not a history, or damaged"):
        HistoryReader.of(text)
    foreign = sqlite3.connect(str(tmp_path / "foreign"))
    foreign.execute("CREATE TABLE birds (name)")
    foreign.commit()
    with pytest.raises(HistoryError, match="another program"):
        HistoryReader.of(tmp_path / "foreign")
    recorded = Recorded(tmp_path)
    recorded.frame()
    recorded.store.close()
    file = sqlite3.connect(str(recorded.path))
    file.execute(f"PRAGMA user_version={VERSION + 1}")
    for use in (HistoryReader.of, lambda path: HistoryStore(path, 100)):
        with pytest.raises(HistoryError, match="newer MERLIN"):
            use(recorded.path)
    file.execute("PRAGMA user_version=0")
    with pytest.raises(HistoryError, match="holds events only.*rosrun merlin history"):
        HistoryReader.of(recorded.path)


def test_a_file_of_before_is_gone_on_with(tmp_path: Path) -> None:
    path = tmp_path / "history.sqlite"
    old = sqlite3.connect(str(path))
    old.executescript(
        "CREATE TABLE events (id INTEGER PRIMARY KEY AUTOINCREMENT, run INTEGER NOT NULL, wall REAL NOT NULL,"
        " at REAL NOT NULL, kind TEXT NOT NULL, text TEXT NOT NULL, detail TEXT NOT NULL);"
        "CREATE TABLE runs (id INTEGER PRIMARY KEY AUTOINCREMENT, began REAL NOT NULL);"
        "INSERT INTO runs (began) VALUES (1.0);"
        "INSERT INTO events (run, wall, at, kind, text, detail) VALUES (1, 1.0, 1.0, 'goal', 'old', '{}');"
    )
    old.close()
    recorded = Recorded(tmp_path)
    recorded.frame()
    recorded.store.add(Event("goal", "new", 2.0, {}, "cancel"))
    reader = recorded.reopened()
    assert [(event["text"], event["mark"]) for event in reader.export().result(LONG)] == [
        ("old", ""),
        ("new", "cancel"),
    ]
    assert [run["run"] for run in reader.runs().result(LONG)] == [2]
    reader.close()


@pytest.mark.parametrize("damage", [b"\x00", b"\xff" * 30])
def test_a_damaged_segment_is_an_error_and_the_others_can_be_read(tmp_path: Path, damage: bytes) -> None:
    recorded = Recorded(tmp_path)
    recorded.frame()
    recorded.store.close()
    with sqlite3.connect(str(recorded.path)) as file:
        Recording(file).add(1, Frame(2, 0, 9.0, damage), 1e9)
    reader = HistoryReader.of(recorded.path)
    with pytest.raises(HistoryError, match="segment 2 of run 1 is damaged"):
        reader.segment(1, 9.0).result(LONG)
    assert state_at(reader, 1, 1.0) == {"plan": {}, "map": {}}
    reader.close()


def test_damaged_frames_take_with_them_only_what_follows_in_their_segment(tmp_path: Path) -> None:
    recorded = Recorded(tmp_path)
    for number in range(20):
        recorded.tree.set("plan", "step", number)
        recorded.frame()
    recorded.store.close()
    file = sqlite3.connect(str(recorded.path))
    with file:
        file.execute("UPDATE frames SET data = x'0099' WHERE number BETWEEN 8 AND 13")
    file.close()
    reader = HistoryReader.of(recorded.path)
    segment = json.loads(reader.segment(1, 15.0).result(LONG) or "null")
    assert segment["damaged"] and len(segment["frames"]) == 8
    for wall, state in recorded.states[:8]:
        assert state_at(reader, 1, wall) == state
    reader.close()


@pytest.mark.parametrize("checked", [True, False], ids=["with checksums", "of before"])
def test_a_bit_that_flips_is_noticed(tmp_path: Path, checked: bool) -> None:
    recorded = Recorded(tmp_path)
    for number in range(10):
        recorded.tree.set(
            "plan", "step", f"step {number} of the plan in the kitchen and hall {number * number}"
        )
        recorded.frame()
    recorded.store.close()
    with sqlite3.connect(str(recorded.path)) as file:
        if not checked:
            file.execute("UPDATE frames SET data = substr(data, 1, length(data) - 4)")
        reader = Recording(file)
        kept = file.execute("SELECT number, data FROM frames ORDER BY number").fetchall()
        good = json.loads(reader.segment(1, 9.0) or "")["frames"]
        assert len(good) == len(kept) == 10
        for number, data in kept[1:]:
            for place in range(0, len(data), 3):
                bits = bytearray(data)
                bits[place] ^= 1 << number % 8
                file.execute("UPDATE frames SET data = ? WHERE number = ?", (bytes(bits), number))
                found = json.loads(reader.segment(1, 9.0) or "")
                assert len(found["frames"]) >= (number if found["damaged"] else len(good))
                if checked:
                    assert found["frames"] == good[: len(found["frames"])]
            file.execute("UPDATE frames SET data = ? WHERE number = ?", (data, number))


def test_a_file_whose_pages_were_overwritten_is_an_error(tmp_path: Path) -> None:
    recorded = Recorded(tmp_path)
    for number in range(200):
        recorded.store.add(Event("goal", f"{number}" * 100, 1.0))
        recorded.tree.set("plan", f"{number}", number)
        recorded.frame()
    recorded.store.close()
    size = recorded.path.stat().st_size
    with recorded.path.open("r+b") as file:
        file.seek(4096)
        file.write(b"\xa5" * (size - 4096))
    with pytest.raises(HistoryError, match="damaged"):
        HistoryReader.of(recorded.path)

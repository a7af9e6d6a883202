# SPDX-License-Identifier: Apache-2.0
"""The history survives restarts, stays bounded, and answers page by page."""

import contextlib
import json
import shutil
import sqlite3
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any, List, Optional

import pytest

from merlin_monitor.history import history_reader
from merlin_monitor.history.frames import Recording
from merlin_monitor.history.history_reader import HistoryReader
from merlin_monitor.panels.control import path_of_node
from merlin_monitor.state import history_store
from merlin_monitor.state.history_events import Event
from merlin_monitor.state.history_store import (
    END_OF_TIME,
    NEWEST,
    HistoryError,
    HistorySection,
    HistoryStore,
)
from merlin_monitor.state.inbox import DirectInbox
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_monitor.state.state_tree import StateTree
from merlin_monitor.text.phrase import in_english
from merlin_test import LONG


def texts(events: List[Any]) -> List[str]:
    return [event["text"] for event in events]


def full(*_: Any) -> None:
    raise sqlite3.OperationalError("the disk is full")


def waited(store: HistoryStore) -> HistoryStore:
    """Where its queue has room again."""
    while store.page(limit=1).exception(LONG):
        pass
    return store


def test_events_outlive_the_store(tmp_path: Path) -> None:
    path = tmp_path / "new" / "history.sqlite"
    store = HistoryStore(path, 1000)
    store.add(Event("goal", "(checked kitchen): succeeded", 12.5, {"began": 1.0, "ended": 12.5}))
    store.add(Event("mission", "it's <b>over</b>\ud800", float("nan")))
    store.close()
    again = HistoryStore(path, 1000)
    first, second = again.page().result(LONG)
    assert (first["kind"], first["at"], first["detail"]) == ("goal", 12.5, {"began": 1.0, "ended": 12.5})
    assert second["text"] == "it's <b>over</b>?" and second["at"] == 0.0
    assert again.run == first["run"] + 1
    again.close()


def test_pages_go_back_to_the_first_event(tmp_path: Path) -> None:
    store = HistoryStore(tmp_path / "h", 1000)
    for number in range(25):
        store.add(Event("plan" if number % 2 else "goal", str(number), 0.0))
    seen: List[str] = []
    before = None
    while True:
        page = store.page(before, 10).result(LONG)
        if not page:
            break
        seen = texts(page) + seen
        before = page[0]["id"]
    assert seen == [str(number) for number in range(25)]
    assert texts(store.page(None, 3, ("plan",)).result(LONG)) == ["19", "21", "23"]
    assert len(store.export().result(LONG)) == 25
    store.close()
    with pytest.raises(HistoryError):
        store.page().result(LONG)


def test_the_oldest_events_go_first(tmp_path: Path) -> None:
    store = HistoryStore(tmp_path / "h", 100)
    for number in range(2300):
        store.add(Event("plan", str(number), 0.0))
        if number % 500 == 0:
            store.page(limit=1).result(LONG)  # waits until what came before is written
    kept = store.export().result(LONG)
    assert 100 <= len(kept) < 1400 and kept[-1]["text"] == "2299"
    store.close()


def test_many_short_runs_are_bounded_too(tmp_path: Path) -> None:
    for run in range(5):
        store = HistoryStore(tmp_path / "h", 100)
        for number in range(60):
            store.add(Event("plan", f"{run} {number}", 0.0))
        store.close()
    store = HistoryStore(tmp_path / "h", 100)
    assert len(store.export().result(LONG)) <= 160
    store.close()


@pytest.mark.parametrize("kinds", [("\udcff",), ("pl'an",)])
def test_a_strange_question_does_not_end_it(tmp_path: Path, kinds: Any) -> None:
    store = HistoryStore(tmp_path / "h", 100)
    with contextlib.suppress(HistoryError):
        assert store.page(kinds=kinds).result(LONG) == []
    store.add(Event("plan", "later", 0.0))
    assert texts(store.page().result(LONG)) == ["later"]
    store.close()


def test_a_question_that_is_cancelled_does_not_end_it(tmp_path: Path) -> None:
    hangs, goes_on = threading.Event(), threading.Event()
    store = HistoryStore(tmp_path / "h", 100)
    store.on_events = lambda events: hangs.set() or goes_on.wait(LONG)  # type: ignore[func-returns-value]
    store.add(Event("plan", "one", 0.0))
    assert hangs.wait(LONG)
    assert store.page().cancel()
    goes_on.set()
    store.add(Event("plan", "two", 0.0))
    assert texts(store.page().result(LONG)) == ["one", "two"]
    store.close()


def test_a_file_that_is_no_history_is_named(tmp_path: Path) -> None:
    path = tmp_path / "h"
    path.write_text("no database at all, but a text of some length to be taken for one")
    with pytest.raises(HistoryError, match=r"h cannot be used.*history:="):
        HistoryStore(path, 100)
    with pytest.raises(HistoryError):
        HistoryStore(tmp_path / "h" / "below", 100)
    with contextlib.closing(sqlite3.connect(str(tmp_path / "foreign"))) as foreign:
        foreign.execute("CREATE TABLE birds (name)")
        foreign.commit()
        with pytest.raises(HistoryError, match="another program"):
            HistoryStore(tmp_path / "foreign", 100)
        assert [row[0] for row in foreign.execute("SELECT name FROM sqlite_master")] == ["birds"]


def problems(state: MonitorModel) -> List[str]:
    state.refresh_problems(1.0)
    return [in_english(problem["said"]) for problem in state.tree.get("now", "problems")]


def test_a_damaged_file_is_set_aside_and_the_monitor_starts(tmp_path: Path) -> None:
    path = tmp_path / "history.sqlite"
    store = HistoryStore(path, 1000)
    for number in range(20):
        store.add(Event("goal", f"{number}" * 500, 0.0))
    store.close()
    with contextlib.closing(sqlite3.connect(str(path))) as file:
        ((root,),) = file.execute("SELECT rootpage FROM sqlite_master WHERE name = 'events'")
        ((size,),) = file.execute("PRAGMA page_size")
    content = bytearray(path.read_bytes())
    content[(root - 1) * size : root * size] = b"\xa5" * size
    path.write_bytes(content)
    state = MonitorModel(DirectInbox(), HistoryStore(path, 1000))
    state.start()
    state.report(Event("goal", "after", 0.0))
    (kept,) = tmp_path.glob("history.sqlite.damaged-????-??-??-*")
    assert b"19" * 500 in kept.read_bytes()
    assert state.history is not None and texts(state.history.page().result(LONG)) == ["after"]
    assert problems(state) == [f"the history was damaged; it is kept as {kept}"]
    state.stop()
    reader = HistoryReader.of(path)
    assert texts(reader.page().result(LONG)) == ["after"]
    reader.close()


def test_a_file_that_cannot_be_written_is_made_when_it_can(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(history_store, "AGAIN", 0.0)
    path = tmp_path / "history.sqlite"
    path.mkdir()
    state = MonitorModel(DirectInbox(), HistoryStore(path, 1000))
    state.start()
    assert problems(state) == ["the history could not be written: unable to open database file"]
    state.report(Event("goal", "meanwhile", 0.0))
    assert state.history is not None and texts(state.history.page().result(LONG)) == ["meanwhile"]
    path.rmdir()
    state.report(Event("goal", "after", 0.0))
    assert texts(state.history.page().result(LONG)) == ["meanwhile", "after"]
    assert problems(state) == []
    state.stop()
    reader = HistoryReader.of(path)
    assert texts(reader.page().result(LONG)) == ["meanwhile", "after"]
    reader.close()


def test_it_waits_for_a_folder_that_is_not_its_to_make(tmp_path: Path) -> None:
    path = tmp_path / "results" / "history.sqlite"
    store = HistoryStore(path, 1000, make_folder=False)
    store.add(Event("plan", "one", 0.0))
    assert texts(store.page().result(LONG)) == ["one"]
    assert not path.parent.exists()
    path.parent.mkdir()
    store.add(Event("plan", "two", 0.0))
    before = store.page().result(LONG)
    assert path.exists()
    store.close()
    again = HistoryStore(path, 1000, make_folder=False)
    assert again.page().result(LONG) == before
    assert texts(before) == ["one", "two"]
    again.close()


def test_a_folder_made_at_the_end_still_gets_the_history(tmp_path: Path) -> None:
    path = tmp_path / "results" / "history.sqlite"
    store = HistoryStore(path, 1000, make_folder=False)
    store.add(Event("plan", "one", 0.0))
    store.page().result(LONG)
    path.parent.mkdir()
    store.close()
    again = HistoryStore(path, 1000)
    assert texts(again.page().result(LONG)) == ["one"]
    again.close()


def test_two_monitors_may_share_a_file(tmp_path: Path) -> None:
    one, two = HistoryStore(tmp_path / "h", 100), HistoryStore(tmp_path / "h", 100)
    one.add(Event("plan", "one", 0.0))
    one.page().result(LONG)
    two.add(Event("plan", "two", 0.0))
    assert texts(two.page().result(LONG)) == ["one", "two"]
    one.close()
    two.close()
    assert sqlite3.connect(str(tmp_path / "h")).execute("SELECT COUNT(*) FROM events").fetchone() == (2,)


@pytest.mark.parametrize("left", [False, True], ids=["with its folder", "the file alone"])
def test_a_file_that_was_removed_is_made_again(tmp_path: Path, left: bool) -> None:
    path = tmp_path / "new" / "history.sqlite"
    tree = StateTree(("plan",))
    store = HistoryStore(path, 1000)
    store.follow(tree, live=False)
    store.add(Event("goal", "before", 0.0))
    store.take()
    assert texts(store.page().result(LONG)) == ["before"]
    if left:
        path.unlink()
    else:
        shutil.rmtree(path.parent)
    for text in ("meanwhile", "after"):
        store.add(Event("goal", text, 0.0))
        assert texts(store.page().result(LONG))[-1] == text
    tree.set("plan", "id", 7)
    store.take()
    reader = HistoryReader.of(path)  # as after a SIGKILL
    assert texts(reader.page().result(LONG)) == ["before", "meanwhile", "after"]
    reader.close()
    store.close()
    again = HistoryStore(path, 1000)
    frames = json.loads(again.segment(store.run, END_OF_TIME).result(LONG) or "")["frames"]
    assert frames[-1][2] == [[["plan", "id"], 7]] and again.run == store.run + 1
    again.close()


def test_of_a_file_that_robots_share_each_page_shows_its_own(tmp_path: Path) -> None:
    of_before = HistoryStore(tmp_path / "h", 100)
    of_before.add(Event("goal", "of before", 0.0))
    of_before.close()
    ann, bob = (HistoryStore(tmp_path / "h", 100, session=f"1 /{name}/monitor") for name in ("ann", "bob"))
    for store in (ann, bob):
        store.follow(StateTree(("plan",)), live=False)
        store.take()
    ann.add(Event("goal", "ann", 0.0))
    assert texts(ann.page().result(LONG)) == ["of before", "ann"]
    for number in range(2 * history_store.PRUNE_EVERY):
        bob.add(Event("goal", f"bob {number}", 0.0))
        bob.page(limit=1).result(LONG)
    assert len(bob.export().result(LONG)) <= 100 + history_store.PRUNE_EVERY
    ann.add(Event("goal", "ann later", 0.0))
    assert texts(ann.export().result(LONG))[-2:] == ["ann", "ann later"]
    assert texts(ann.page(limit=2).result(LONG)) == ["ann", "ann later"]
    assert [run["run"] for run in ann.runs().result(LONG)] == [ann.run]
    ann.close()
    bob.close()
    again = HistoryStore(tmp_path / "h", 100, session="2 /ann/monitor")
    assert texts(again.page().result(LONG))[-2:] == ["ann", "ann later"]
    again.close()
    reader = HistoryReader.of(tmp_path / "h")
    assert [run["run"] for run in reader.runs().result(LONG)] == [ann.run, bob.run]
    reader.close()


def test_a_file_that_two_monitors_share_is_made_again_for_both(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(history_store, "AGAIN", 0.0)
    path = tmp_path / "h"
    stores = {name: HistoryStore(path, 1000, session=f"1 /{name}/monitor") for name in ("ann", "bob")}
    trees = {name: StateTree(("plan",)) for name in stores}
    wanted = []
    for name, store in stores.items():
        store.follow(trees[name], live=False)
    for text in ("before", "after", "later"):
        for name, store in stores.items():
            trees[name].set("plan", "id", f"{name} {text}")
            store.add_picture("map", f"{name} {text}", b"map")
            store.take()
            store.add(Event("goal", f"{name} {text}", 0.0))
            store.page().result(LONG)
            assert store.trouble == ""
            wanted.append(f"{name} {text}")
        if text == "before":
            path.unlink()
    for store in stores.values():
        store.close()
    reader = HistoryReader.of(path)
    assert sorted(texts(reader.export().result(LONG))) == sorted(wanted)
    assert [run["run"] for run in reader.runs().result(LONG)] == [store.run for store in stores.values()]
    for name, store in stores.items():
        frames = json.loads(reader.segment(store.run, END_OF_TIME).result(LONG) or "")["frames"]
        shown = [value for _, _, changes, _ in frames[1:] for _, value in changes]
        assert shown == [f"{name} after", f"{name} later"]
    assert all(reader.picture("map", text).result(LONG) for text in wanted)
    reader.close()


@pytest.mark.parametrize("why", ["the disk was full", "too much came"])
def test_a_picture_that_could_not_be_kept_comes_with_the_next_whole_state(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, why: str
) -> None:
    tree = StateTree(("map",))
    store = HistoryStore(tmp_path / "h", 1000)
    store.follow(tree, live=False)
    store.take()
    store.add_picture("seen", "of before", b"seen")
    store.page().result(LONG)
    if why == "the disk was full":
        with monkeypatch.context() as patch:
            patch.setattr(Recording, "put_picture", full)
            store.add_picture("map", "now", b"map")
            store.page().result(LONG)
        assert store.trouble == "the disk is full"
    else:
        hangs, goes_on = threading.Event(), threading.Event()
        store.on_events = lambda events: hangs.set() or goes_on.wait(LONG)  # type: ignore[func-returns-value]
        store.add(Event("goal", "first", 0.0))
        assert hangs.wait(LONG)
        for number in range(history_reader.WAITING):
            store.add(Event("goal", str(number), 0.0))
        store.add_picture("map", "now", b"map")
        goes_on.set()
    assert waited(store).picture("map", "now").result(LONG) is None
    for picture in ("now", "later"):
        tree.set("map", "picture", picture)
        store.take()
    assert store.picture("map", "now").result(LONG) == b"map"
    assert store.picture("seen", "of before").result(LONG) == b"seen"
    store.close()


def test_its_end_waits_for_no_disk_that_hangs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(history_reader, "CLOSING", 0.01)
    hangs, goes_on = threading.Event(), threading.Event()
    store = HistoryStore(tmp_path / "h", 1000)
    store.on_events = lambda events: hangs.set() or goes_on.wait(LONG)  # type: ignore[func-returns-value]
    store.add(Event("goal", "first", 0.0))
    assert hangs.wait(LONG)
    for number in range(history_reader.WAITING):
        store.add(Event("goal", str(number), 0.0))
    closing = threading.Thread(target=store.close)
    closing.start()
    closing.join(LONG)
    ended = not closing.is_alive()
    goes_on.set()
    closing.join(LONG)
    assert ended


def test_the_state_holds_the_newest_events_only() -> None:
    tree = StateTree()
    section = HistorySection(tree)
    for number in range(NEWEST + 50):
        section.add([{"id": number, "text": str(number)}])
    assert tree.keys("history", "events") == [str(number) for number in range(50, NEWEST + 50)]


def test_that_nothing_can_be_written_takes_the_place_of_no_other_event() -> None:
    tree = StateTree()
    section = HistorySection(tree)
    section.add([{"id": 1, "text": "before"}])
    for number in range(2 * NEWEST):
        section.add([{"id": 0, "text": f"the history could not be written, {number}"}])
    assert sorted(tree.keys("history", "events")) == ["0", "1"]
    assert tree.get("history", "events", "0", "text").endswith(str(2 * NEWEST - 1))


@pytest.mark.parametrize(("text", "path"), [("", None), ("none", None), ("/tmp/none", Path("/tmp/none"))])
def test_a_launch_file_can_ask_for_no_history(text: str, path: Optional[Path]) -> None:
    ros = SimpleNamespace(parameter=lambda name, default: {"~history": text}[name])
    assert path_of_node(ros, "~history") == path  # type: ignore[arg-type]

# SPDX-License-Identifier: Apache-2.0
"""A bag opens as a folder of results does: any moment of it, at its own times, and nothing of a master."""

import json
import os
import signal
import sqlite3
import sys
from pathlib import Path
from typing import Any, Dict, List, Tuple

import genpy
import pytest
import rosbag
import yaml
from actionlib_msgs.msg import GoalID
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import TransformStamped
from merlin_msgs.msg import ExecutorStatus, KnowledgeChanges, MissionStatus, SimStatus
from rosplan_knowledge_msgs.msg import KnowledgeItem
from shown_page import AXE, CHECK, Visit, chromium
from sound_play.msg import SoundRequest, SoundRequestActionGoal
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

from merlin_monitor.bag import KNOWLEDGE, PARAMETERS, bag_import
from merlin_monitor.bag.bag_import import BagClock, import_bag
from merlin_monitor.bag.recording import BagRecording
from merlin_monitor.history.frames import Recording
from merlin_monitor.history.history_file import HistoryError
from merlin_monitor.history.history_reader import HistoryReader
from merlin_monitor.panel_board import PanelBoard
from merlin_monitor.state.state_tree import apply_changes
from merlin_monitor.text.phrase import in_english
from merlin_monitor.web import open_command
from merlin_ros.health import ENDED, STALE
from merlin_test import LONG

pytestmark = pytest.mark.processes
BEGIN = 1_700_000_000.0  # s since 1970, of a robot
KITCHEN = {"x": 4.0, "y": 2.0, "yaw": 0.0}
Reported = Tuple[str, Any, float, str]


def stamped(message: Any, at: float) -> Any:
    message.header.stamp = genpy.Time.from_sec(at)
    return message


def changes(at: float, *added: str, cleared: bool = False) -> KnowledgeChanges:
    items = [KnowledgeItem(knowledge_type=KnowledgeItem.FACT, attribute_name=name) for name in added]
    return stamped(KnowledgeChanges(added=items, cleared=cleared), at)


def pose(at: float, x: float) -> TFMessage:
    transform = TransformStamped(child_frame_id="ann/base_footprint")
    transform.header.frame_id = "map"
    transform.transform.translation.x = x
    transform.transform.rotation.w = 1.0
    return TFMessage([stamped(transform, at)])


def said(words: str) -> SoundRequestActionGoal:
    goal = SoundRequestActionGoal()
    goal.goal.sound_request = SoundRequest(sound=SoundRequest.SAY, arg=words)
    return goal


def reports(name: str, level: int = DiagnosticStatus.OK, message: str = "well") -> DiagnosticArray:
    return DiagnosticArray(status=[DiagnosticStatus(level, f"{name}: life", message, "", [])])


def record(path: Path, begin: float, *reported: Reported, panels: Any = (), **more: Any) -> Path:
    """A bag of the robot ann: topics, messages, s after the begin, nodes that published them."""
    parameters = {
        "/ann/world": {"points_of_interest": {"kitchen": KITCHEN}},
        "/ann/merlin_monitor/panels": list(panels),
        **more,
    }
    first = (f"/ann/{PARAMETERS}", String(yaml.safe_dump(parameters)), 0.0, "/ann/recorded_state")
    with rosbag.Bag(str(path), "w") as bag:
        for topic, message, after, node in (first, *reported):
            header = {
                "topic": topic,
                "type": message._type,
                "md5sum": message._md5sum,
                "message_definition": message._full_text,
                "callerid": node,
            }
            bag.write(topic, message, genpy.Time.from_sec(begin + after), connection_header=header)
    return path


def robot(path: Path, **options: Any) -> Path:
    """20 s of a robot: it knows, drives, says, is cancelled; a node of it dies."""
    on = [("/tf", pose(BEGIN + at / 4, at / 4), at / 4, "/ann/base") for at in range(80)]
    life = [("/diagnostics", reports("cook"), float(at), "/cook") for at in range(8)]
    return record(
        path,
        BEGIN,
        (f"/ann/{KNOWLEDGE}", changes(BEGIN + 0.1, "hungry", cleared=True), 0.2, "/ann/recorded_state"),
        ("/ann/merlin/mission", stamped(MissionStatus(mission="tea", state=1, task=1), BEGIN + 1), 1.0, "/m"),
        ("/ann/merlin/status", stamped(ExecutorStatus(), BEGIN + 1), 1.0, "/ann/executor"),
        ("/ann/sound_play/goal", stamped(said("Tea is ready"), BEGIN + 5), 5.0, "/ann/say"),
        ("/ann/rosplan_knowledge_base/changes", changes(BEGIN + 10, "served"), 10.0, "/ann/kb"),
        ("/ann/merlin/execute/cancel", GoalID(), 12.0, "/ann/merlin_monitor"),
        *on,
        *life,
        **options,
    )


class Opened:
    """The history of a bag."""

    def __init__(self, bag: Path, complain: Any = print) -> None:
        file = bag.with_name("history.sqlite")
        import_bag(BagRecording(bag), file, complain=complain)
        self.reader = HistoryReader.of(file)
        (self.run,) = self.reader.runs().result(LONG)

    def at(self, wall: float) -> Dict[str, Any]:
        """What is shown of a moment."""
        found = json.loads(self.reader.segment(self.run["run"], wall).result(LONG) or "")
        (_, _, state, _), *later = found["frames"]
        for at, _, frame, _ in later:
            if at <= wall:
                apply_changes(state, frame)
        return state

    def of(self, wall: float) -> Dict[str, Any]:
        """What the page shows of an event: the first frame that is not earlier."""
        found = json.loads(self.reader.segment(self.run["run"], wall).result(LONG) or "")
        return self.at(next(at for at, *_ in found["frames"] if at >= wall))

    def events(self) -> List[Tuple[str, float]]:
        return [(row["text"], row["wall"]) for row in self.reader.export().result(LONG)]


@pytest.fixture
def no_master(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_MASTER_URI", open_command.NO_MASTER)


@pytest.mark.usefixtures("no_master")
def test_any_moment_is_what_the_bag_has_reported_until_then(tmp_path: Path) -> None:
    opened = Opened(robot(tmp_path / "run.bag"))
    early, late = opened.at(BEGIN + 8.0), opened.at(BEGIN + 19.0)
    assert (list(early["knowledge"]["facts"]), early["meta"]["robot"]) == (["(hungry)"], "ann")
    assert sorted(late["knowledge"]["facts"]) == ["(hungry)", "(served)"]
    for state, x in ((early, 8.0), (late, 19.0)):
        assert state["map"]["robot"][0] == pytest.approx(x, abs=0.6)
    assert [in_english(entry["words"]) for entry in early["said"]["entries"]] == ["Tea is ready"]
    assert not opened.at(BEGIN + 4.0)["said"]["entries"]
    assert late["map"]["points"]["kitchen"][:2] == [4.0, 2.0]
    assert {panel["name"] for panel in late["meta"]["panels"]} > {"now", "plan", "map", "machines"}


@pytest.mark.usefixtures("no_master")
def test_its_words_are_those_of_the_sentences_in_the_bag(tmp_path: Path) -> None:
    kept = {"file": "/nowhere/sentences.yaml", "text": "predicates: {served: {en: the tea is there}}"}
    status = stamped(ExecutorStatus(state=ExecutorStatus.RUNNING, goals=["(served)"]), BEGIN + 1)
    reported = ("/ann/merlin/status", status, 1.0, "/ann/executor")
    opened = Opened(record(tmp_path / "run.bag", BEGIN, reported, **{"/ann/merlin/sentences": kept}))
    assert "the tea is there" in json.dumps(opened.at(BEGIN + 1.0))


@pytest.mark.usefixtures("no_master")
def test_the_times_of_a_robot_are_those_of_its_bag(tmp_path: Path) -> None:
    opened = Opened(robot(tmp_path / "run.bag"))
    assert opened.run["began"] == pytest.approx(BEGIN, abs=0.3)
    assert opened.run["ended"] == pytest.approx(BEGIN + 19.75, abs=0.3)
    when = dict(opened.events())
    assert when["said “Tea is ready”"] == pytest.approx(BEGIN + 5.0, abs=0.01)
    (silent,) = [wall for text, wall in opened.events() if text == "cook: life has fallen silent"]
    assert BEGIN + 9.5 < silent < BEGIN + 10.5, "2.5 s after its last word"
    (cancelled,) = [text for text, wall in opened.events() if abs(wall - BEGIN - 12.0) < 0.01]
    assert "/ann/merlin_monitor" in cancelled


@pytest.mark.usefixtures("no_master")
def test_a_simulation_is_as_fast_as_it_was_and_ends_when_its_bag_was_written(tmp_path: Path) -> None:
    fast = [
        ("/merlin_sim/status", SimStatus(achieved_factor=4.0), 4.0 * at, "/merlin_sim") for at in range(10)
    ]
    bag = record(tmp_path / "run.bag", 3.0, *fast, ("/ann/sound_play/goal", said("Tea"), 20.0, "/ann/say"))
    os.utime(bag, (BEGIN, BEGIN))
    opened = Opened(bag)
    assert opened.run["ended"] == pytest.approx(BEGIN, abs=0.1)
    assert opened.run["began"] == pytest.approx(BEGIN - 36.0 / 4.0, abs=0.3)
    (event,) = [row for row in opened.reader.export().result(LONG) if row["kind"] == "speech"]
    assert (event["at"], event["wall"]) == (pytest.approx(23.0), pytest.approx(BEGIN - 4.0, abs=0.01))
    state = opened.at(BEGIN)
    assert state["meta"]["simulated"] is True and state["meta"]["simulator"]["factor"] == 4.0


def test_both_times_of_a_simulation_lead_to_each_other() -> None:
    clock = BagClock(5.0, 25.0, [(5.0, 1.0), (15.0, 2.0), (20.0, 0.5)], written=1000.0)
    assert (clock.begin, clock.end) == (1000.0 - 25.0, 1000.0)  # 10 s at 2, 5 s at 0.5, and 5 s more at that
    for at in (5.0, 7.5, 15.0, 19.0, 25.0):
        assert clock.time(clock.wall(at)) == pytest.approx(at)


@pytest.mark.usefixtures("no_master")
def test_what_has_ended_in_order_is_not_missed_when_the_recording_goes_on(tmp_path: Path) -> None:
    executor, end = "/ann/executor", BEGIN + 7
    life = [("/diagnostics", reports("ann/executor"), float(at), executor) for at in range(8)]
    opened = Opened(
        record(
            tmp_path / "run.bag",
            BEGIN,
            *life,
            ("/ann/merlin/status", stamped(ExecutorStatus(), BEGIN + 1), 1.0, executor),
            ("/ann/merlin/mission", stamped(MissionStatus(mission="tea", state=3), end), 7.0, "/m"),
            ("/diagnostics", reports("ann/executor", STALE, ENDED), 7.5, executor),
            ("/ann/sound_play/goal", stamped(said("Bye"), BEGIN + 20), 20.0, "/ann/say"),
        )
    )
    late = opened.at(BEGIN + 20.0)
    assert late["now"]["doing"] == "tea has ended: no more", late["now"]
    assert late["now"]["problems"] == [] and late["health"]["parts"] == {}
    assert dict(opened.events())["/ann/executor has ended"] == pytest.approx(BEGIN + 7.5, abs=0.01)


@pytest.mark.usefixtures("no_master")
def test_a_long_silence_costs_nothing_and_moves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    beats: List[None] = []
    beat = PanelBoard.beat
    monkeypatch.setattr(PanelBoard, "beat", lambda board: (beats.append(None), beat(board)))
    day = 86_400.0
    reported = [
        ("/ann/sound_play/goal", said(words), at, "/ann/say")
        for words, at in (("Late", day), ("Later", day + 1))
    ]
    opened = Opened(record(tmp_path / "run.bag", BEGIN, *reported))
    assert len(beats) < 1000
    late = dict(opened.events())["said “Late”"]
    assert late == pytest.approx(BEGIN + day, abs=0.01)
    assert [in_english(entry["words"]) for entry in opened.of(late)["said"]["entries"]] == ["Late"]


@pytest.mark.usefixtures("no_master")
def test_a_panel_that_is_not_here_is_left_out(tmp_path: Path) -> None:
    complaints: List[str] = []
    opened = Opened(robot(tmp_path / "run.bag", panels=["nowhere.panel:Nothing"]), complaints.append)
    assert "plan" in {panel["name"] for panel in opened.at(BEGIN + 19.0)["meta"]["panels"]}
    (complaint,) = complaints
    assert complaint.startswith("a panel is left out: ") and "nowhere" in complaint


@pytest.mark.usefixtures("no_master")
def test_a_disk_that_takes_nothing_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: Any) -> None:
        raise sqlite3.OperationalError("no space left")

    monkeypatch.setattr(Recording, "add", full)
    with pytest.raises(HistoryError, match=r"history\.sqlite cannot be written: no space left"):
        Opened(robot(tmp_path / "run.bag"))


# --- the command --------------------------------------------------------------------------------------------


def run(monkeypatch: pytest.MonkeyPatch, *words: object) -> int:
    monkeypatch.setenv("ROS_MASTER_URI", "http://localhost:11311")
    monkeypatch.setattr(sys, "argv", ["open", *map(str, words), "--port", "0"])
    return open_command.main()


@pytest.mark.parametrize("given", [".", "run.bag"])
def test_the_page_of_a_bag_is_served_and_its_history_kept_where_it_is_wanted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any, given: str
) -> None:
    robot(tmp_path / "run.bag")
    monkeypatch.setattr(open_command, "wait_for_end", lambda key: None)
    monkeypatch.setattr(open_command, "LINES", LONG)  # a busy machine reads for so long that it says how far
    kept = tmp_path / "kept"
    assert run(monkeypatch, tmp_path / given, "--into", kept) == 0
    out, errors = capsys.readouterr()
    assert out.startswith("http://127.0.0.1:") and errors == ""
    assert HistoryReader.of(kept).runs().result(LONG)
    assert run(monkeypatch, kept) == 0, "it opens as any other history"
    assert run(monkeypatch, tmp_path / given, "--into", kept) == open_command.EXIT_MISTAKES
    assert "already" in capsys.readouterr().err


def test_the_page_of_a_bag_plays_jumps_and_has_links(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    robot(tmp_path / "run.bag")
    looked: List[str] = []

    def look(address: str) -> None:
        with chromium() as browser:
            visit = Visit(browser, address, bypass_csp=True)
            visit.wait_text("#past-banner strong", "RECORDING of ")
            visit.wait_text("#connection", "past")
            visit.page.add_script_tag(path=AXE)
            assert visit.page.evaluate(CHECK) == []
            visit.page.keyboard.press("Shift+F")  # the last failure: the cook has fallen silent
            begin, end = BEGIN + 9.5, BEGIN + 10.5
            visit.wait(
                "([begin, end]) => { const [, run, wall] = location.hash.match(/^#moment=(\\d+)@(.*)/) || [];"
                " return run === '1' && begin < Number(wall) && Number(wall) < end; }",
                [begin, end],
                LONG,
            )
            link = Visit(browser, f"{address}#moment=1@{BEGIN + 8.0}")
            link.wait_text("#knowledge", "hungry")
            assert "served" not in link.page.inner_text("#knowledge")
            link.page.select_option("#time-speed", "60")
            link.page.keyboard.press("k")
            link.wait_text("#time-said", "The end of this run.")
            link.wait_text("#knowledge", "served")
            assert visit.complaints == [] and link.complaints == []
            link.close()
            visit.close()

    def wait(key: bool) -> None:
        looked.append(capsys.readouterr().out.split()[0])
        look(looked[0])

    monkeypatch.setattr(open_command, "wait_for_end", wait)
    assert run(monkeypatch, tmp_path / "run.bag") == 0
    assert looked


def test_nothing_is_left_when_it_is_not_to_be_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    robot(tmp_path / "run.bag")
    for_files = tmp_path / "tmp"
    for_files.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(for_files))
    seen: List[Path] = []
    monkeypatch.setattr(open_command, "wait_for_end", lambda key: seen.extend(for_files.rglob("*.sqlite")))
    assert run(monkeypatch, tmp_path / "run.bag") == 0
    assert len(seen) == 1 and not list(for_files.iterdir())


def unindexed(path: Path) -> None:
    with rosbag.Bag(str(path), "w", chunk_threshold=1) as bag:  # as when its recorder is killed
        bag.write("/chatter", String("hello"), genpy.Time(1))
        bag.flush()
        content = path.read_bytes()
    path.write_bytes(content)


def foreign(path: Path) -> None:
    with rosbag.Bag(str(path), "w") as bag:
        bag.write("/chatter", String("hello"), genpy.Time(1))


def broken(path: Path) -> None:
    """A message of the bag cannot be read."""
    record(path, BEGIN, ("/ann/sound_play/goal", said("Tea is ready"), 1.0, "/ann/say"))
    content = path.read_bytes()
    path.write_bytes(content.replace(b"\x0c\x00\x00\x00Tea is ready", b"\xff\xff\xff\x7fTea is ready"))


BAD = {
    "missing": (lambda path: None, "there is no bag"),
    "a text": (lambda path: path.write_text("hello"), "is damaged, or not a bag"),
    "of another program": (foreign, "is not a recording of record:=true"),
    "without an index": (unindexed, "rosbag reindex"),
    "a damaged message": (broken, "is damaged: a message of /ann/sound_play/goal"),
}


@pytest.mark.parametrize("kind", BAD)
def test_a_bag_that_cannot_be_shown_is_one_line(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    make, text = BAD[kind]
    make(tmp_path / "run.bag")
    kept = tmp_path / "kept"
    assert run(monkeypatch, tmp_path / "run.bag", "--into", kept) == open_command.EXIT_MISTAKES
    out, errors = capsys.readouterr()
    assert out == "" and errors.count("\n") == 1
    assert errors.startswith("open: ") and text in errors
    assert not (kept / "history.sqlite").exists()


def test_an_encrypted_bag_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    robot(tmp_path / "run.bag")

    def locked(*words: object) -> None:
        raise rosbag.bag.ROSBagEncryptException("Failed to decrypt bag")

    monkeypatch.setattr(rosbag, "Bag", locked)
    assert run(monkeypatch, tmp_path / "run.bag") == open_command.EXIT_MISTAKES
    errors = capsys.readouterr().err
    assert errors.count("\n") == 1 and "is encrypted" in errors


def test_a_folder_that_cannot_be_made_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    bag = robot(tmp_path / "run.bag")
    assert run(monkeypatch, bag, "--into", bag / "kept") == open_command.EXIT_MISTAKES
    errors = capsys.readouterr().err
    assert errors.count("\n") == 1 and "cannot be used" in errors


def test_a_history_is_not_put_elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    assert run(monkeypatch, tmp_path, "--into", tmp_path / "kept") == open_command.EXIT_MISTAKES
    assert "--into is for a bag" in capsys.readouterr().err


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_half_a_history_is_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int, code: int
) -> None:
    robot(tmp_path / "run.bag")
    record = bag_import.RecordedModel.record

    def interrupted(model: bag_import.RecordedModel) -> None:
        record(model)
        assert list((tmp_path / "kept").iterdir())
        os.kill(os.getpid(), number)

    monkeypatch.setattr(bag_import.RecordedModel, "record", interrupted)
    words = (monkeypatch, tmp_path / "run.bag", "--into", tmp_path / "kept")
    if number == signal.SIGINT:
        assert run(*words) == code
    else:
        with pytest.raises(SystemExit) as ended:
            run(*words)
        assert ended.value.code == code
    assert not list((tmp_path / "kept").iterdir())


def test_how_far_it_is_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    robot(tmp_path / "run.bag")
    monkeypatch.setattr(open_command, "wait_for_end", lambda key: None)
    monkeypatch.setattr(open_command, "LINES", 0.0)
    assert run(monkeypatch, tmp_path / "run.bag") == 0
    lines = capsys.readouterr().err.splitlines()
    parts = [int(line.split()[2]) for line in lines]
    assert len(parts) > 2 and parts == sorted(parts) and parts[-1] <= 100
    assert all("0.3 min" in line for line in lines)

# SPDX-License-Identifier: Apache-2.0
"""Recordings: what is played for them, and bags that cannot be shown."""

import os
import re
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, Dict, List, Tuple

import genpy
import pytest
import rosbag
import rospy
import yaml
from geometry_msgs.msg import TransformStamped
from merlin_msgs.msg import KnowledgeChanges, MissionStatus
from nav_msgs.msg import Odometry
from rosplan_knowledge_msgs.msg import KnowledgeItem
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

from merlin.replay import command
from merlin.replay.recorded_state import recorded_parameters
from merlin_monitor.bag import KNOWLEDGE, PARAMETERS
from merlin_monitor.bag.recording import BagRecording, RecordingError
from merlin_monitor.listeners.ros_system import RosSystem
from merlin_monitor.panels.control import sentences_of_node
from merlin_test import LONG

CHANGES = "/r1/rosplan_knowledge_base/changes"
BEGIN = 100.0


def fact(name: str) -> KnowledgeItem:
    return KnowledgeItem(knowledge_type=KnowledgeItem.FACT, attribute_name=name)


def changes(at: float, version: int, *added: str, cleared: bool = False) -> KnowledgeChanges:
    message = KnowledgeChanges(version=version, added=[fact(name) for name in added], cleared=cleared)
    message.header.stamp = genpy.Time.from_sec(at)
    return message


def fixed(child: str) -> TFMessage:
    transform = TransformStamped(child_frame_id=child)
    transform.header.frame_id = "base_link"
    return TFMessage([transform])


def record(path: Path, *messages: Tuple[str, Any, float], **more: Any) -> Path:
    """A bag with the parameters of a recording and these messages: topic, message, s after its begin."""
    with rosbag.Bag(str(path), "w") as bag:
        parameters = String(yaml.safe_dump({"/r1/world": {"points_of_interest": {}}, **more}))
        bag.write(f"/r1/{PARAMETERS}", parameters, genpy.Time.from_sec(BEGIN))
        for topic, message, after in messages:
            bag.write(topic, message, genpy.Time.from_sec(BEGIN + after))
    return path


def recorded(path: Path) -> Path:
    return record(
        path,
        (CHANGES, changes(BEGIN, 7, "before_the_reading"), 0.1),
        (CHANGES, changes(BEGIN + 0.3, 8, "while_reading"), 0.3),
        (f"/r1/{KNOWLEDGE}", changes(BEGIN + 0.2, 0, "all", cleared=True), 0.4),
        ("/r1/merlin/mission", MissionStatus(task=1), 1.0),
        ("/r1/odom", Odometry(), 1.5),
        ("/tf_static", fixed("camera"), 2.0),
        ("/tf_static", fixed("laser"), 2.1),
        ("/r1/merlin/mission", MissionStatus(task=2), 3.0),
        (CHANGES, changes(BEGIN + 5.0, 20, "after_a_gap"), 5.0),
        ("/r1/odom", Odometry(), 6.0),
    )


def played(path: Path, start: float = 0.0) -> Dict[str, List[Tuple[Any, float]]]:
    """Topic -> messages and s after the begin of the recording."""
    found: Dict[str, List[Tuple[Any, float]]] = {}
    target = path.with_name("played.bag")
    BagRecording(path).write(target, start)
    with rosbag.Bag(str(target)) as bag:
        for topic, message, at in bag.read_messages():
            found.setdefault(topic, []).append((message, at.to_sec() - BEGIN))
    return found


def test_the_knowledge_is_one_row_of_changes_that_begins_with_all_that_was_known(tmp_path: Path) -> None:
    reported = [message for message, _ in played(recorded(tmp_path / "run.bag"))[CHANGES]]
    names = [[item.attribute_name for item in message.added] for message in reported]
    assert names == [["all"], ["while_reading"], ["after_a_gap"]]
    assert [message.version for message in reported] == [1, 2, 3]
    assert reported[0].cleared


def test_namespace_and_parameters_are_those_of_the_robot(tmp_path: Path) -> None:
    recording = BagRecording(recorded(tmp_path / "run.bag"))
    assert (recording.namespace, recording.length) == ("r1", pytest.approx(6.0))
    assert recording.parameters == {"/r1/world": {"points_of_interest": {}}}
    assert BagRecording(tmp_path).length == recording.length  # the results folder


def test_a_recording_keeps_the_sentences_of_then(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    name, file = "/r1/merlin/sentences", tmp_path / "sentences.yaml"
    warned: List[str] = []
    monkeypatch.setattr(rospy, "logwarn", warned.append)
    monkeypatch.setattr(rospy, "resolve_name", lambda name: f"/r1/{name}")
    monkeypatch.setattr(
        rospy, "get_param", lambda key, default: str(file) if key == "merlin/sentences" else default
    )
    file.write_text("operators: {greet: {en: greets}}")
    bag = record(tmp_path / "run.bag", ("/r1/tf_static", fixed("laser"), 1.0), **recorded_parameters())
    file.write_text("operators: {greet: {en: shouts}}")
    parameters = BagRecording(bag).parameters
    # As the page of a replay gets it.
    monkeypatch.setattr(rospy, "get_param", lambda key, default: parameters.get(f"/r1/{key}", default))
    assert sentences_of_node(RosSystem()).operators == {"greet": {"en": "greets"}}
    # One of before, with the path only, has none, as the words there may be other ones by now.
    bag = record(tmp_path / "run.bag", ("/r1/tf_static", fixed("laser"), 1.0), **{name: str(file)})
    assert name not in BagRecording(bag).parameters
    assert not warned


def test_a_recording_keeps_the_domain_and_the_panels_of_then(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, panels = tmp_path / "domain.pddl", {"why": "merlin_explain.node.why_panel:WhyPanel"}
    file.write_text("(define (domain errands))")
    given = {"rosplan_knowledge_base/domain_path": str(file), "merlin/panels": panels}
    monkeypatch.setattr(rospy, "resolve_name", lambda name: f"/r1/{name}")
    monkeypatch.setattr(rospy, "get_param", lambda key, default: given.get(key, default))
    found = recorded_parameters()
    assert found["/r1/merlin/panels"] == panels
    assert found["/r1/rosplan_knowledge_base/domain_path"] == {"file": str(file), "text": file.read_text()}


def test_sentences_that_cannot_be_read_are_not_recorded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "sentences.yaml"
    warned: List[str] = []
    monkeypatch.setattr(rospy, "logwarn", warned.append)
    monkeypatch.setattr(rospy, "resolve_name", lambda name: f"/r1/{name}")
    monkeypatch.setattr(
        rospy, "get_param", lambda key, default: str(file) if key == "merlin/sentences" else default
    )
    assert recorded_parameters() == {}
    file.write_text("operators: 5")
    assert recorded_parameters() == {}
    assert [str(file) in warning for warning in warned] == [True, True]


def test_what_was_known_before_the_start_is_written_at_the_start_in_its_order(tmp_path: Path) -> None:
    found = played(recorded(tmp_path / "run.bag"), 4.0)
    tasks = [(message.task, at) for message, at in found["/r1/merlin/mission"]]
    assert [task for task, _ in tasks] == [1, 2]
    assert all(at == pytest.approx(4.0, abs=0.01) for _, at in tasks) and tasks[0][1] < tasks[1][1]
    assert [at for _, at in found[CHANGES]] == pytest.approx([4.0, 4.0, 5.0], abs=0.01)
    assert len(found["/r1/odom"]) == 1  # where it was before is of no use


def test_fixed_frames_are_written_at_once(tmp_path: Path) -> None:
    ((message, at),) = played(recorded(tmp_path / "run.bag"))["/tf_static"]
    assert {each.child_frame_id for each in message.transforms} == {"camera", "laser"}
    assert at == pytest.approx(0.0, abs=0.01)


def test_a_start_after_the_end_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="lasts 6.0 s"):
        played(recorded(tmp_path / "run.bag"), 60.0)


def foreign(path: Path) -> None:
    with rosbag.Bag(str(path), "w") as bag:
        bag.write("/chatter", String("hello"), genpy.Time(1))


def unindexed(path: Path) -> None:
    with rosbag.Bag(str(path), "w", chunk_threshold=1) as bag:  # never closed, as when its recorder is killed
        bag.write("/chatter", String("hello"), genpy.Time(1))
        bag.flush()
        content = path.read_bytes()
    path.write_bytes(content)


def cut(path: Path) -> None:
    content = recorded(path).read_bytes()
    path.write_bytes(content[: len(content) // 2])


def overwritten(path: Path) -> None:
    content = bytearray(recorded(path).read_bytes())
    content[5000:9000] = b"x" * len(content[5000:9000])
    path.write_bytes(bytes(content))


def active(path: Path) -> None:
    recorded(path).rename(path.with_name("run.bag.active"))


def garbled(text: str) -> Any:
    """A recording with a text in the place of its parameters."""

    def make(path: Path) -> None:
        with rosbag.Bag(str(path), "w") as bag:
            bag.write(f"/r1/{PARAMETERS}", String(text), genpy.Time.from_sec(BEGIN))

    return make


def unreadable(topic: str) -> Any:
    """A recording with a message that ends too early."""

    def make(path: Path) -> None:
        recorded(path)
        kind = String if topic.endswith(PARAMETERS) else KnowledgeChanges
        with rosbag.Bag(str(path), "a") as bag:
            raw = kind._type, b"\xff\xff", kind._md5sum, 0, kind
            bag.write(topic, raw, genpy.Time.from_sec(BEGIN + 1.0), raw=True)

    return make


BAD = {
    "parameters that are no YAML": (garbled("a: ["), "is damaged: .* has no parameters"),
    "parameters that are a list": (garbled("- a"), "is damaged: .* has no parameters"),
    "parameters that are numbers": (garbled("{1: 2}"), "is damaged: .* has no parameters"),
    "parameters that end early": (unreadable(f"/r1/{PARAMETERS}"), "is damaged: .* cannot be read"),
    "a change that ends early": (unreadable(CHANGES), f"is damaged: a message of {CHANGES} cannot be read"),
    "missing": (lambda path: None, "there is no bag"),
    "a text": (lambda path: path.write_text("hello"), "is damaged, or not a bag"),
    "nothing in it": (lambda path: path.write_bytes(b""), "is damaged, or not a bag"),
    "of another program": (foreign, "is not a recording of record:=true"),
    "without an index": (unindexed, "rosbag reindex"),
    "cut off": (cut, "rosbag reindex|is damaged"),
    "overwritten": (overwritten, "is damaged"),
    "not ended": (active, "is still being recorded"),
}


@pytest.mark.parametrize("kind", BAD)
def test_a_bag_that_cannot_be_shown_is_one_line(
    kind: str, tmp_path: Path, monkeypatch: Any, capsys: Any
) -> None:
    make, text = BAD[kind]
    make(tmp_path / "run.bag")
    monkeypatch.setattr("sys.argv", ["replay", str(tmp_path / "run.bag")])
    assert command.main() == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("merlin replay: ")
    assert re.search(text, line)


def test_where_nothing_can_be_written_no_bag_is_played(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.setattr("sys.argv", ["replay", str(recorded(tmp_path / "run.bag"))])
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "gone"))
    assert command.main() == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("merlin replay: ") and str(tmp_path / "gone") in line


ENDED = """
import os, sys
from merlin.replay import command
command.BagRecording.write = lambda *_: os.kill(os.getpid(), {number})
sys.exit(command.main())
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_replay_that_is_ended_while_it_reads_leaves_nothing(tmp_path: Path, number: signal.Signals) -> None:
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    words = [sys.executable, "-c", ENDED.format(number=int(number)), str(recorded(tmp_path / "run.bag"))]
    run = subprocess.run(
        words,
        env={**os.environ, "TMPDIR": str(scratch)},
        capture_output=True,
        text=True,
        timeout=LONG,
        check=False,
    )
    assert run.returncode == 128 + number
    assert "Traceback" not in run.stderr and not list(scratch.iterdir())


@pytest.mark.parametrize("option", ["--start=nan", "--start=-1", "--rate=nan", "--rate=slow"])
def test_a_number_that_is_not_a_time_is_refused(option: str, monkeypatch: Any, capsys: Any) -> None:
    monkeypatch.setattr("sys.argv", ["replay", "run.bag", option])
    with pytest.raises(SystemExit):
        command.main()
    assert (
        f"argument {option.partition('=')[0]}: {option.partition('=')[2]} is not" in capsys.readouterr().err
    )


def test_a_recording_of_other_messages_is_refused(tmp_path: Path, monkeypatch: Any) -> None:
    path = recorded(tmp_path / "run.bag")
    monkeypatch.setattr(MissionStatus, "_md5sum", "0" * 32)
    with pytest.raises(RecordingError, match="merlin_msgs/MissionStatus differs"):
        BagRecording(path)

# SPDX-License-Identifier: Apache-2.0
"""A bag that ``record:=true`` has written: what is in it, and the bag that is played for it."""

import contextlib
import io
import struct
from pathlib import Path
from typing import Any, Dict, Iterator, List, NamedTuple, Optional, Tuple

import genpy
import rosbag
import roslib.message
import yaml
from merlin_msgs.msg import KnowledgeChanges
from tf2_msgs.msg import TFMessage

from merlin_monitor.bag import BAG, KNOWLEDGE, PARAMETERS
from merlin_monitor.panels.control import SENTENCES

#: Types of messages that come many times per second: of those before the start only the present is of use.
STREAMS = ("tf2_msgs/TFMessage", "nav_msgs/Odometry", "geometry_msgs/Twist", "rosgraph_msgs/Clock")
FIXED = "/tf_static"
#: Of a knowledge base of which no change was recorded, below the robot's namespace.
CHANGES = "rosplan_knowledge_base/changes"
#: What reading a damaged bag raises.
DAMAGE = (
    rosbag.ROSBagException,
    genpy.DeserializationError,
    struct.error,
    ValueError,
    KeyError,
    EOFError,
    RuntimeError,
)
STEP = genpy.Duration(0, 1000)  # between messages written at the start, to keep their order
#: Packages whose messages differ between versions of MERLIN and of what is below it.
ALIKE = ("merlin_msgs/", "rosplan_", "smach_msgs/")


class RecordingError(Exception):
    """The bag cannot be shown; the text is one line that says what is wrong and what to do."""


class Message(NamedTuple):
    """A message as it lies in a bag."""

    topic: str
    raw: Tuple[Any, ...]  # type, bytes, checksum, …, class
    at: genpy.Time
    header: Dict[str, Any]  # of its connection

    @property
    def sender(self) -> str:
        """Name of the node that published it; empty when the bag does not have it."""
        name = self.header.get("callerid", b"")
        return name.decode(errors="replace") if isinstance(name, bytes) else str(name)

    @property
    def type(self) -> str:
        """Name of its type."""
        return str(self.raw[0])

    def read(self, message_class: Any = None) -> Any:
        """The message itself.

        :param message_class: of it; None: the one that lies in the bag.
        :raises RecordingError: it is damaged.
        """
        try:
            return (message_class or self.raw[-1])().deserialize(self.raw[1])
        except DAMAGE as error:
            raise RecordingError(
                f"the bag is damaged: a message of {self.topic} cannot be read: {error}"
            ) from error

    def write(self, bag: Any, at: genpy.Time) -> None:
        """Writes it into another bag."""
        bag.write(self.topic, self.raw, at, raw=True, connection_header=self.header or None)


class BagRecording:
    """A recording that can be shown.

    :param path: of the bag, or of a results folder with ``run.bag``.
    :raises RecordingError: when it is missing, damaged, without an index, not a bag, or of something else.

    :ivar path: of the bag.
    :ivar namespace: of the robot, without slashes at its ends.
    :ivar parameters: by absolute name; the sentences as `file` and `text`, not in older recordings.
    :ivar topics: name → type.
    :ivar begin, end: s of ROS time.
    :ivar length: s.
    :ivar written: s since 1970 when it was ended.
    """

    def __init__(self, path: Path) -> None:
        self.path = path / BAG if path.is_dir() else path
        if not self.path.is_file():
            unfinished = self.path.with_name(self.path.name + ".active")
            raise RecordingError(
                f"{unfinished} is still being recorded, or its recording was killed; "
                f"then 'rosbag reindex {unfinished}' makes a bag of it"
                if unfinished.is_file()
                else f"there is no bag {self.path}; record one with record:=true, and give it or its folder"
            )
        self.namespace, self.parameters, self.topics = "", {}, {}
        with self._opened() as bag:
            checksums, topics = bag.get_type_and_topic_info()
            self.topics = {name: topic.msg_type for name, topic in topics.items()}
            states = [name for name in self.topics if name.endswith(f"/{PARAMETERS}")]
            if not states:
                raise RecordingError(
                    f"{self.path} has no topic {PARAMETERS}: it is not a recording of record:=true"
                )
            if len(states) > 1:
                raise RecordingError(f"{self.path} has several robots: {', '.join(sorted(states))}")
            self.begin, self.end = bag.get_start_time(), bag.get_end_time()
        self.length = self.end - self.begin
        self.written = self.path.stat().st_mtime
        self.namespace = states[0][: -len(PARAMETERS)].strip("/")
        for message in self.of_topic(states[0]):
            self.parameters = _parameters(message)
        self._check_versions(checksums)

    def write(self, target: Path, start: float = 0.0) -> None:
        """Writes the bag that is to be played.

        What came before the start is published at its begin, so that all is known that was known then. The
        knowledge that was read when the recording began is its first change.

        :param start: s after the begin of the recording.
        :raises RecordingError: when the bag is damaged, or shorter than this.
        """
        if not 0.0 <= start < max(self.length, 1e-9):
            raise RecordingError(
                f"--start {start:g} is not within the recording, which lasts {self.length:.1f} s"
            )
        begin = genpy.Time.from_sec(self.begin + start)
        before: List[Message] = []
        fixed: Dict[str, Any] = {}  # child frame → transform
        with rosbag.Bag(str(target), "w") as bag:
            for message in self.messages():
                if message.topic == FIXED:
                    fixed.update({each.child_frame_id: each for each in message.read().transforms})
                elif message.at >= begin:
                    self._write_before(bag, before, begin)
                    message.write(bag, message.at)
                elif message.type not in STREAMS:
                    before.append(message)
            self._write_before(bag, before, begin)
            if fixed:
                # One message: of several latched ones of one publisher, only the last would be kept.
                tree = TFMessage(list(fixed.values()))
                header = {"topic": FIXED, "type": tree._type, "md5sum": tree._md5sum, "latching": "1"}
                header["message_definition"] = tree._full_text
                Message(FIXED, _raw(tree), begin, header).write(bag, begin)

    def _write_before(self, bag: Any, before: List[Message], begin: genpy.Time) -> None:
        first = begin - genpy.Duration.from_sec(len(before) * STEP.to_sec())
        for number, message in enumerate(before):
            message.write(bag, first + genpy.Duration(0, STEP.nsecs * number))
        before.clear()

    def of_topic(self, name: str) -> Iterator[Message]:
        """The messages of one topic.

        :raises RecordingError: the bag is damaged.
        """
        return self._messages([name])

    def messages(self) -> Iterator[Message]:
        """All messages that are shown, in their order, with changes of the knowledge as one row without gaps.

        :raises RecordingError: the bag is damaged.
        """
        announced = [
            name
            for name, kind in self.topics.items()
            if kind == KnowledgeChanges._type and KNOWLEDGE not in name
        ]
        topic = announced[0] if announced else f"/{self.namespace}/{CHANGES}".replace("//", "/")
        known: Any = None
        early: List[Any] = []
        version = 0
        for message in self._messages():
            if message.topic.endswith(PARAMETERS) or message.type == "rosgraph_msgs/Clock":
                continue
            if message.type != KnowledgeChanges._type:
                yield message
                continue
            changes = [message.read()]
            if message.topic.endswith(KNOWLEDGE):
                known = changes[0]
                changes += [change for change in early if change.header.stamp >= known.header.stamp]
            elif known is None:  # contained in what is read next, or published after it
                early += changes
                continue
            for change in changes:
                version += 1
                change.version = version
                yield Message(topic, _raw(change), message.at, {})

    def _messages(self, topics: Optional[List[str]] = None) -> Iterator[Message]:
        with self._opened() as bag:
            found = bag.read_messages(topics, raw=True, return_connection_header=True)
            for topic, raw, at, header in found:
                yield Message(topic, raw, at, header)

    @contextlib.contextmanager
    def _opened(self) -> Iterator[Any]:
        try:
            with rosbag.Bag(str(self.path)) as bag:
                if not bag.get_message_count():
                    raise RecordingError(f"{self.path} is empty")
                yield bag
        except rosbag.ROSBagUnindexedException:
            raise RecordingError(
                f"{self.path} has no index, because its recording was killed; "
                f"'rosbag reindex {self.path}' makes one"
            ) from None
        except (rosbag.bag.ROSBagEncryptException, rosbag.bag.ROSBagEncryptNotSupportedException):
            raise RecordingError(
                f"{self.path} is encrypted, and its key is not here; "
                f"'rosbag decrypt {self.path}' needs the private key"
            ) from None
        except OSError as error:
            raise RecordingError(f"{self.path} cannot be read: {error.strerror or error}") from error
        except DAMAGE as error:
            raise RecordingError(f"{self.path} is damaged, or not a bag: {error}") from error

    def _check_versions(self, checksums: Dict[str, str]) -> None:
        for kind, checksum in checksums.items():
            ours = roslib.message.get_message_class(kind) if kind.startswith(ALIKE) else None
            if ours is not None and ours._md5sum != checksum:
                raise RecordingError(
                    f"{self.path} was recorded by another version of MERLIN: {kind} differs; "
                    "replay it with that version"
                )


def _raw(message: Any) -> Tuple[Any, ...]:
    buffer = io.BytesIO()
    message.serialize(buffer)
    return message._type, buffer.getvalue(), message._md5sum, 0, type(message)


def parameter_tree(parameters: Dict[str, Any]) -> Dict[str, Any]:
    """Parameters by absolute name, as a tree of namespaces."""
    tree: Dict[str, Any] = {}
    for name, value in parameters.items():
        *folders, last = name.strip("/").split("/")
        place = tree
        for folder in folders:
            place = place.setdefault(folder, {})
        place[last] = value
    return tree


def _parameters(message: Message) -> Dict[str, Any]:
    try:
        parameters = yaml.safe_load(message.read().data)
    except yaml.YAMLError:
        parameters = None
    if not isinstance(parameters, dict) or not all(isinstance(name, str) for name in parameters):
        raise RecordingError(f"the bag is damaged: {message.topic} has no parameters")
    return {
        name: value
        for name, value in parameters.items()
        if not name.endswith(f"/{SENTENCES}") or isinstance(value, dict)
    }

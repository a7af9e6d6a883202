# SPDX-License-Identifier: Apache-2.0
"""A node stays connected to a publisher that lives, however its connections break."""

import contextlib
import queue
import signal
import socket
import struct
import threading
import xmlrpc.client
from typing import Any, Dict, Iterator, List, Tuple
from xmlrpc.server import SimpleXMLRPCServer

import pytest
from std_msgs.msg import String

from merlin_test import LONG

pytestmark = pytest.mark.processes

TOPIC = "/news"
SUBSCRIBER = f"""
import rospy
from std_msgs.msg import String
from merlin_ros.node import init_node
init_node("listener")
news = rospy.Subscriber("{TOPIC}", String, lambda message: print("heard", message.data, flush=True))
print("listens", flush=True)
rospy.spin()
"""

IMPATIENT = """
from merlin_ros.master import publisher_updates
publisher_updates.PAUSES, publisher_updates.ANSWER = (0.0,), 0.05
"""


def _bytes(text: str) -> bytes:
    return struct.pack("<I", len(text)) + text.encode()


class Publisher:
    """A publisher of its own making, which closes connections when a test wants it to."""

    def __init__(self, master: Any, name: str) -> None:
        self._requests: queue.Queue[threading.Event] = queue.Queue()
        self.hold_requests = False
        self._door = socket.create_server(("127.0.0.1", 0))
        self._door.settimeout(LONG)
        self._server = SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False, allow_none=True)
        self._server.register_function(self._request_topic, "requestTopic")
        self._server.register_function(self._publications, "getPublications")
        self.publishes = True
        self.answers = threading.Event()
        self.answers.set()
        self._asked: queue.Queue[bool] = queue.Queue()
        self.uri = f"http://127.0.0.1:{self._server.server_address[1]}/"
        self._thread = threading.Thread(target=self._serve, name="publisher", daemon=True)
        self._thread.start()
        self._name = name
        self._master = master

    def _serve(self) -> None:
        # One thread per request, so that one may wait.
        while True:
            request, address = self._server.get_request()
            threading.Thread(
                target=self._server.process_request, args=(request, address), name="request", daemon=True
            ).start()

    def _request_topic(self, caller: str, topic: str, protocols: List[Any]) -> List[Any]:
        answered = threading.Event()
        self._requests.put(answered)
        if self.hold_requests:
            assert answered.wait(LONG)
        return [1, "", ["TCPROS", "127.0.0.1", self._door.getsockname()[1]]]

    def _publications(self, caller: str) -> List[Any]:
        self._asked.put(self.publishes)
        assert self.answers.wait(LONG)
        return [1, "", [[TOPIC, String._type]] if self.publishes else []]

    def asked(self) -> bool:
        """Waits until it is asked what it publishes; whether it has named the topic."""
        return self._asked.get(timeout=LONG)

    def register(self) -> None:
        self._master.api.registerPublisher(self._name, TOPIC, String._type, self.uri)

    def requested(self) -> threading.Event:
        return self._requests.get(timeout=LONG)

    def requests_left(self) -> int:
        return self._requests.qsize()

    def accept(self) -> socket.socket:
        """The next connection, whose greeting is read."""
        connection, _ = self._door.accept()
        connection.settimeout(LONG)
        (length,) = struct.unpack("<I", connection.recv(4, socket.MSG_WAITALL))
        assert TOPIC.encode() in connection.recv(length, socket.MSG_WAITALL)
        return connection

    def waits(self) -> bool:
        """Whether a connection waits to be accepted."""
        self._door.settimeout(0.0)
        with contextlib.suppress(BlockingIOError):
            self._door.accept()[0].close()
            return True
        return False

    def greet(self, connection: socket.socket, **more: str) -> None:
        fields: Dict[str, str] = {"callerid": self._name, "md5sum": String._md5sum, "type": String._type}
        fields.update(more)
        header = b"".join(_bytes(f"{key}={value}") for key, value in fields.items())
        connection.sendall(struct.pack("<I", len(header)) + header)

    @staticmethod
    def say(connection: socket.socket, text: str) -> None:
        data = _bytes(text)
        connection.sendall(struct.pack("<I", len(data)) + data)


@pytest.fixture
def talk(master: Any) -> Iterator[Tuple[Any, Publisher]]:
    listener = master.node(SUBSCRIBER)
    listener.expect("listens")
    yield listener, Publisher(master, "/talker")
    assert listener.end() == 0


def test_a_connection_that_breaks_while_it_is_greeted_is_made_again(talk: Tuple[Any, Publisher]) -> None:
    listener, talker = talk
    talker.register()
    talker.accept().close()
    connection = talker.accept()
    talker.greet(connection)
    talker.say(connection, "hello")
    listener.expect("heard hello")


def test_a_connection_that_breaks_later_is_made_again(talk: Tuple[Any, Publisher]) -> None:
    listener, talker = talk
    talker.register()
    for text in ("one", "two", "three"):
        with talker.accept() as connection:
            talker.greet(connection)
            talker.say(connection, text)
            listener.expect(f"heard {text}")


def test_two_words_of_one_publisher_make_one_connection(master: Any, talk: Tuple[Any, Publisher]) -> None:
    listener, talker = talk
    talker.hold_requests = True
    talker.register()
    first = talker.requested()
    # The master tells of all publishers again: of the first one before this one.
    other = Publisher(master, "/other")
    other.register()
    other.greet(other.accept())
    first.set()
    connection = talker.accept()
    talker.greet(connection)
    talker.say(connection, "hello")
    listener.expect("heard hello")
    assert talker.requests_left() == 0
    assert not talker.waits()


def test_a_publisher_that_has_ended_a_topic_is_connected_to_when_it_makes_it_again(
    talk: Tuple[Any, Publisher],
) -> None:
    listener, talker = talk
    talker.publishes = False
    talker.register()
    with talker.accept() as connection:
        talker.greet(connection, error=f"not a publisher of {TOPIC}")
    assert not talker.asked()
    talker.publishes = True
    talker.register()
    connection = talker.accept()
    talker.greet(connection)
    talker.say(connection, "hello")
    listener.expect("heard hello")


def test_a_publisher_is_connected_to_however_long_its_network_was_gone(master: Any) -> None:
    listener, talker = master.node(IMPATIENT + SUBSCRIBER), Publisher(master, "/talker")
    listener.expect("listens")
    talker.register()
    connection = talker.accept()
    talker.greet(connection)
    talker.answers.clear()
    connection.close()
    for _ in range(30):
        assert talker.asked()
    talker.answers.set()
    connection = talker.accept()
    talker.greet(connection)
    talker.say(connection, "hello")
    listener.expect("heard hello")
    assert listener.end() == 0


def test_a_first_connection_needs_no_answer_of_the_master(master: Any, talk: Tuple[Any, Publisher]) -> None:
    listener, talker = talk
    node = xmlrpc.client.ServerProxy(master.address_of("/listener"))
    master.process.send(signal.SIGSTOP)
    node.publisherUpdate("/master", TOPIC, [talker.uri])  # the master's last word
    connection = talker.accept()
    talker.greet(connection)
    talker.say(connection, "hello")
    listener.expect("heard hello")
    master.process.send(signal.SIGCONT)

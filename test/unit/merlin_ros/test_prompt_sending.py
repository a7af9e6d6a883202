# SPDX-License-Identifier: Apache-2.0
"""A publisher's connection: sends in the publishing thread, never waits, drops only what rospy would."""

import os
import socket
import threading
from typing import Any, Iterator, List, Tuple

import pytest
import rospy
from rospy.exceptions import TransportInitError, TransportTerminated

from merlin_ros import prompt_sending
from merlin_ros.prompt_sending import PromptConnection
from merlin_test import LONG

# Its end waits for a subscriber as long as the test may take.
SAYS = f"""
import sys, rospy
from merlin_ros import prompt_sending
from merlin_ros.node import run_node
from std_msgs.msg import String
prompt_sending.READ_LIMIT = {LONG}
class Connected(rospy.SubscribeListener):
    def peer_subscribe(self, *_):
        print("connected", flush=True)
def start():
    words = rospy.Publisher("words", String, Connected(), queue_size=int(sys.argv[1]) or None)
    def run():
        print("announced", flush=True)
        sys.stdin.readline()
        words.publish("last")
        rospy.signal_shutdown("said")
    return run
sys.exit(run_node("speaker", start))
"""
LARGE = 8 * 1024 * 1024  # bytes; more than a connection takes without a reader


class Transport:
    """A connection to a subscriber."""

    endpoint_id = "subscriber"
    cleanup_cb: Any = None

    def __init__(self, peer: socket.socket) -> None:
        self.socket: Any = peer
        self.done = False
        self.stat_bytes = self.stat_num_msg = 0

    def fileno(self) -> int:
        return int(self.socket.fileno())

    def set_cleanup_callback(self, call: Any) -> None:
        self.cleanup_cb = call

    def close(self) -> None:
        if not self.done:  # as rospy's: what is called back closes it, too
            self.done = True
            self.cleanup_cb(self)

    def write_data(self, data: bytes) -> None:
        self.socket.sendall(data)
        self.stat_bytes += len(data)
        self.stat_num_msg += 1


@pytest.fixture
def pair() -> Iterator[Tuple[Transport, socket.socket]]:
    ours, theirs = socket.socketpair()
    theirs.settimeout(LONG)
    yield Transport(ours), theirs
    ours.close()
    theirs.close()


def read(peer: socket.socket, count: int) -> bytes:
    received = bytearray()
    while len(received) < count:
        piece = peer.recv(65536)
        assert piece, f"the connection ended after {len(received)} of {count} bytes"
        received += piece
    return bytes(received)


def test_a_message_is_sent_by_the_thread_that_publishes_it(pair: Tuple[Transport, socket.socket]) -> None:
    transport, peer = pair
    known = set(threading.enumerate())
    connection = PromptConnection(transport, 10)
    assert connection.write_data(b"a message")
    peer.setblocking(False)
    assert peer.recv(100) == b"a message"
    # Others of the process may come and go meanwhile.
    assert not [each for each in set(threading.enumerate()) - known if each.name.startswith("sending")]
    assert (transport.stat_num_msg, transport.stat_bytes) == (1, 9)


def test_a_small_message_waits_for_no_acknowledgement() -> None:
    server = socket.create_server(("127.0.0.1", 0))
    with server, socket.create_connection(server.getsockname()) as peer:
        PromptConnection(Transport(peer), 10)
        assert peer.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)


def test_what_comes_behind_an_empty_one_is_sent_to_a_slow_subscriber(
    pair: Tuple[Transport, socket.socket],
) -> None:
    transport, peer = pair
    connection = PromptConnection(transport, 0)
    for message in (b"a" * LARGE, b"", b"b"):  # smach_ros sends nothing to see what has been sent
        connection.write_data(message)
    assert read(peer, LARGE + 1)[-1:] == b"b"


def test_a_slow_subscriber_gets_every_message_whole_and_in_order(
    pair: Tuple[Transport, socket.socket],
) -> None:
    transport, peer = pair
    connection = PromptConnection(transport, 0)
    messages = [bytes([number]) * LARGE for number in range(4)]
    for message in messages:
        connection.write_data(message)  # returns although nothing is read
    connection.write_data(b"end")
    assert read(peer, 4 * LARGE + 3) == b"".join(messages) + b"end"


def test_a_full_queue_drops_the_oldest_message_and_none_in_part(
    pair: Tuple[Transport, socket.socket],
) -> None:
    transport, peer = pair
    connection = PromptConnection(transport, 1)
    held = threading.Event()
    write = transport.write_data

    def held_write(data: bytes) -> None:
        held.wait(LONG)
        write(data)

    transport.write_data = held_write  # type: ignore[method-assign]
    for message in (b"a" * LARGE, b"b", b"c"):
        connection.write_data(message)
    held.set()
    assert read(peer, LARGE + 1) == b"a" * LARGE + b"c"


def test_messages_of_several_threads_stay_whole(pair: Tuple[Transport, socket.socket]) -> None:
    transport, peer = pair
    connection = PromptConnection(transport, 0)
    size, count = 5000, 200

    def publish(letter: bytes) -> None:
        for _ in range(count):
            connection.write_data(letter * size)

    threads = [threading.Thread(target=publish, args=(letter,)) for letter in (b"x", b"y", b"z")]
    for thread in threads:
        thread.start()
    received = read(peer, 3 * count * size)
    pieces = [received[at : at + size] for at in range(0, len(received), size)]
    assert sorted(set(pieces)) == [b"x" * size, b"y" * size, b"z" * size]


def test_after_a_slow_subscriber_has_caught_up_no_thread_is_left(
    pair: Tuple[Transport, socket.socket],
) -> None:
    transport, peer = pair
    connection = PromptConnection(transport, 0)
    known = set(threading.enumerate())
    connection.write_data(b"a" * LARGE)
    workers = [thread for thread in threading.enumerate() if thread not in known]
    read(peer, LARGE)
    for worker in workers:
        worker.join(LONG)
        assert not worker.is_alive()
    connection.write_data(b"next")
    assert read(peer, 4) == b"next"


def test_a_broken_connection_is_reported_to_its_publisher(pair: Tuple[Transport, socket.socket]) -> None:
    transport, peer = pair
    connection = PromptConnection(transport, 10)
    peer.close()
    with pytest.raises(TransportTerminated):
        connection.write_data(b"a message")
    transport.socket = None
    with pytest.raises(TransportInitError):
        connection.write_data(b"a message")
    transport.done = True
    with pytest.raises(TransportTerminated, match="closed"):
        connection.write_data(b"a message")


def test_a_connection_that_breaks_while_messages_wait_is_reported_with_the_next_one(
    pair: Tuple[Transport, socket.socket],
) -> None:
    transport, peer = pair
    connection = PromptConnection(transport, 10)
    known = set(threading.enumerate())
    connection.write_data(b"a" * LARGE)
    workers = [thread for thread in threading.enumerate() if thread not in known]
    peer.close()
    for worker in workers:
        worker.join(LONG)
    with pytest.raises(OSError):
        connection.write_data(b"next")


def test_a_connection_ends_after_what_was_published_is_read(pair: Tuple[Transport, socket.socket]) -> None:
    transport, peer = pair
    connection = PromptConnection(transport, 0)
    connection.write_data(b"a" * LARGE)
    connection.write_data(b"last")
    ending = threading.Thread(target=prompt_sending.finish, args=([connection], LONG))
    ending.start()
    assert read(peer, LARGE + 4) == b"a" * LARGE + b"last"
    assert peer.recv(1) == b""
    assert ending.is_alive()
    assert connection.write_data(b"more")  # is dropped, and not an error of the topic
    peer.close()
    ending.join(LONG)
    assert not ending.is_alive()


def test_a_subscriber_that_does_not_read_keeps_no_node_from_its_end(
    pair: Tuple[Transport, socket.socket],
) -> None:
    transport, peer = pair
    stuck = PromptConnection(transport, 0)
    stuck.write_data(b"a" * LARGE)
    ours, theirs = socket.socketpair()
    with ours:
        theirs.close()
        gone = PromptConnection(Transport(ours), 0)
        closed = Transport(ours)
        closed.done, closed.socket = True, None
        prompt_sending.finish([gone, stuck, PromptConnection(closed, 0)], 0.05)
    assert read(peer, LARGE) == b"a" * LARGE and peer.recv(1) == b""


@pytest.mark.processes
@pytest.mark.parametrize("queue", ["1", "0"])  # 0: none, as in much of rospy's users' code
def test_a_node_is_at_the_master_until_its_last_message_is_read(master: Any, queue: str) -> None:
    node = master.node(SAYS, queue)
    node.expect("announced")
    with master.subscribed("/speaker", "/words") as peer:
        node.expect("connected")
        node.say("")
        with peer.makefile("rb") as file:
            assert file.read().endswith(b"last")
        assert master.address_of("/speaker")
    assert node.ended() == 0
    assert not master.address_of("/speaker")


def test_rospy_connects_its_publishers_like_this(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("QueuedConnection", "Poller"):
        monkeypatch.setattr(rospy.topics, name, getattr(rospy.topics, name))  # is put back
    monkeypatch.setattr(rospy.core, "_preshutdown_hooks", [])
    prompt_sending.send_promptly()
    ours, theirs = socket.socketpair()
    with ours, theirs:
        publisher = rospy.topics._PublisherImpl("/topic", rospy.AnyMsg)
        publisher.set_queue_size(1)
        publisher.add_connection(Transport(ours))
        connections: List[Any] = publisher.connections
        assert isinstance(connections[0], PromptConnection)
        publisher.close()  # not when the garbage is collected, in the middle of another test
    assert connections[0].done


def test_a_subscriber_that_comes_again_while_it_is_removed_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rospy.topics, "QueuedConnection", PromptConnection)
    monkeypatch.setattr(rospy.topics, "Poller", prompt_sending.PlainPoller)
    publisher: Any = rospy.topics._PublisherImpl("/topic", rospy.AnyMsg)
    publisher.set_queue_size(1)

    class Closing(Transport):
        """Its thread loses the processor between the end of its socket and the callback."""

        def fileno(self) -> int:
            return number

        def close(self) -> None:
            if not self.done:
                self.done = True
                self.socket.close()
                ours, self.theirs = socket.socketpair()
                if ours.fileno() != number:
                    os.dup2(ours.fileno(), number)
                    ours.close()
                    ours = socket.socket(fileno=number)
                publisher.add_connection(Transport(ours))
                self.cleanup_cb(self)

    ours, theirs = socket.socketpair()
    number = ours.fileno()
    gone = Closing(ours)
    publisher.add_connection(gone)
    gone.close()
    (connection,) = publisher.connections
    assert connection.write_data(b"a message") and gone.theirs.recv(100) == b"a message"
    publisher.close()
    for each in (theirs, gone.theirs):
        each.close()

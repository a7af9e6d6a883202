# SPDX-License-Identifier: Apache-2.0
"""Keeps a node registered with its master, and reports when the master is lost and when it is back."""

import contextlib
import errno
import http.client
import select
import socket
import threading
import time
import xmlrpc.client
from typing import Any, Callable, List, Mapping, Optional, Sequence, Tuple
from urllib.parse import urlsplit
from xml.parsers.expat import ExpatError

import rosgraph
import rospy
from rospy.core import is_shutdown_requested

from merlin_ros.alarms import TickClock, wait_ticks
from merlin_ros.master import master_link
from merlin_ros.master.foreign_nodes import ForeignNodes
from merlin_ros.master.master_watch import HUNG, MasterWatch, WatchDecision
from merlin_ros.master.registration import ERRORS, KeptParameters, RegistrationError, register_again
from merlin_ros.work.threads import CallQueue, start_thread

#: Between two questions to the master, s of wall time.
PERIOD = 1.0
#: Longest wait for a connection, and for an answer to other questions, s of wall time.
PING_TIMEOUT = 1.0
#: Longest wait for the answer of a slow master, s; then it is asked anew: a question may be lost on its way.
QUESTION = 10.0
#: Bytes of an answer that are compared with the last one; a longer answer is read anew each time.
LARGEST = 16 * 1024
#: Questions between two looks at the node's parameters.
LOOKS = 5
#: s of wall time that nodes have to register at a master that was started anew, before it is done for them.
FOREIGN_GRACE = 3.0
#: Periods in which a node is tried again of which the master has got only a part; a stall uses up none.
FOREIGN_TRIES = 30
#: Longest wait for a registration that is under way when the node ends, s of wall time.
END_TIMEOUT = 3.0

Callback = Callable[[], None]


class _Question:
    """Calls of the master that are made again and again, over one connection, and mostly answered alike.

    A node asks every second for its whole life: what is answered word for word as before is not parsed, and
    what is asked is not written, again.

    :param calls: pairs of a method's name and its parameters.
    :param wait: waits until a socket can be read; raises an OSError to give up.
    """

    def __init__(
        self, uri: str, calls: Sequence[Tuple[str, Sequence[Any]]], wait: Callable[[socket.socket], None]
    ) -> None:
        named = [{"methodName": name, "params": list(parameters)} for name, parameters in calls]
        text = xmlrpc.client.dumps((named,), "system.multicall").encode()
        address = urlsplit(uri)
        self._address = str(address.hostname), address.port or 80
        fields = f"Host: {address.netloc}\r\nContent-Type: text/xml\r\nContent-Length: {len(text)}"
        self._request = f"POST {address.path or '/RPC2'} HTTP/1.1\r\n{fields}\r\n\r\n".encode() + text
        self._wait = wait
        self._socket: Optional[socket.socket] = None
        self._said = b""  # the last answer, when it can be recognised by its end
        self._answers: Any = []

    def ask(self) -> Any:
        """The answers of the calls, one after the other; to read one that is a fault raises it.

        :raises OSError: it cannot be asked, or `wait` gave up.
        :raises http.client.HTTPException: its answer cannot be read; as xmlrpc.client.Error, ExpatError.
        """
        kept = self._socket is not None
        try:
            return self._ask()
        except ConnectionError:
            if not kept:
                raise
            return self._ask()  # the master had closed the connection

    def _ask(self) -> Any:
        if self._socket is None:
            self._socket = socket.create_connection(self._address, PING_TIMEOUT)
        connection, self._socket = self._socket, None  # a failure ends it
        with contextlib.ExitStack() as failure:
            failure.callback(connection.close)
            connection.sendall(self._request)
            self._wait(connection)
            said = connection.recv(LARGEST, socket.MSG_PEEK)
            if self._said and said.endswith(self._said):
                connection.recv(len(said))
            elif not said:
                raise ConnectionResetError(errno.ECONNRESET, "the master closed the connection")
            else:
                self._read(connection)
            if self._said:
                self._socket = connection
                failure.pop_all()
        return xmlrpc.client.MultiCallIterator(self._answers)

    def _read(self, connection: socket.socket) -> None:
        response = http.client.HTTPResponse(connection, method="POST")
        response.begin()
        body = response.read()
        if response.status != http.client.OK:
            raise http.client.BadStatusLine(f"{response.status} {response.reason}")
        (self._answers,), _ = xmlrpc.client.loads(body)
        self._said = b"" if response.will_close or response.chunked else body


class MasterKeeper:
    """Asks the master once per period whether it lives and knows this node.

    :param name: of this node, global.
    :param uri: of this node.
    """

    def __init__(self, name: str, uri: str) -> None:
        self._parameters = KeptParameters()
        self._parameters.keep(name)
        self._parameters.keep(rospy.resolve_name("merlin"))  # what a launch file says to all nodes of a robot
        self._name = name
        self._watch = MasterWatch(uri)
        self._master_uri = rosgraph.get_master_uri()
        calls = ("getPid", (name,)), ("lookupNode", (name, name))
        self._question = _Question(self._master_uri, calls, self._wait)
        self._unanswered = 0.0  # s since the last answer, in ticks of the thread that asks
        self._stopped = threading.Event()
        self._registering = threading.Lock()  # held while something is registered
        self._foreign: Optional[ForeignNodes] = None
        self._foreign_due: Optional[float] = None  # monotonic time from which they are registered
        self._foreign_tries = 0
        self._news = CallQueue("master news")
        # Without a lock: each use is one step of Python's.
        self.on_lost: List[Callback] = []
        """Called, in a thread of its own, each time the master is lost."""
        self.on_back: List[Callback] = []
        """Called, in the same thread, each time the node is registered again after that."""
        self.on_replaced: List[Callback] = []
        """Called, in the same thread, each time the node is registered with another master process."""

    def keep_params(self, name: str) -> Optional[Mapping[str, Any]]:
        """Restores the parameters below a name too, at a master that has lost them; looks at its own too.

        :param name: global.

        Returns the present ones; None: the master does not answer.
        """
        self._parameters.keep(name)
        try:
            master = master_link.bounded_master(PING_TIMEOUT)
            value = self._parameters.look(master, name, self._name).get(name)
        except ERRORS:
            return None  # the next call shows whether the master is lost
        return value if isinstance(value, dict) else {}

    def keep_foreign_nodes(self) -> None:
        """Registers other nodes at a master that was started anew, where they do not do that themselves.

        They are looked for at once: a master may be lost before the first of the regular looks.
        """
        foreign = ForeignNodes()
        with contextlib.suppress(*ERRORS):
            foreign.look(master_link.bounded_master(PING_TIMEOUT))
        self._foreign = foreign  # from here on it is the thread's

    def start(self) -> None:
        """Begins to ask."""
        self._look()
        start_thread("master keeper", self._work)  # its own: it waits for the master

    def stop(self) -> None:
        """Ends. Nothing is registered any more when this returns."""
        self._stopped.set()
        if self._registering.acquire(timeout=END_TIMEOUT):
            self._registering.release()

    def _going_on(self) -> bool:
        return not self._stopped.is_set() and not is_shutdown_requested()

    def _work(self) -> None:
        count = 1  # the first look was at the start
        while self._going_on():
            begun = time.monotonic()
            decision = self._ask()
            self._act(decision)
            if decision in (WatchDecision.BACK_SAME, WatchDecision.BACK_NEW):
                self._register(decision)
            elif decision is WatchDecision.TAKEN:
                rospy.logerr(
                    f"{self._name}: the master has another node of this name; "
                    "this one can no longer be reached and has to be ended"
                )
            elif count % LOOKS == 0 and not self._watch.lost:
                self._look()
                self._look_at_others()
            if self._foreign_due is not None and time.monotonic() >= self._foreign_due:
                self._register_foreign()
            count += 1
            self._stopped.wait(max(0.0, PERIOD - (time.monotonic() - begun)))

    def _ask(self) -> WatchDecision:
        try:
            process, address = self._ping()
        except (socket.timeout, TimeoutError):
            self._unanswered += PING_TIMEOUT  # no connection: a master that hangs takes only a few
            return self._watch.unanswered(self._unanswered)
        except (OSError, http.client.HTTPException, xmlrpc.client.Error, ExpatError, ValueError, TypeError):
            return self._watch.refused()
        was_silent, self._unanswered = self._watch.silent, 0.0
        decision = self._watch.answered(process, address, master_link.missed.is_set())
        if was_silent and not self._watch.lost:
            master_link.silent.clear()
            rospy.logwarn(f"{self._name}: the master at {self._master_uri} answers again")
        return decision

    def _wait(self, sock: socket.socket) -> None:
        """Waits for an answer; what runs pauses meanwhile when it does not come."""
        ticks, poll = TickClock(), select.poll()
        poll.register(sock, select.POLLIN)

        def attempt(seconds: float) -> bool:
            if poll.poll(seconds * 1000):
                return True
            self._unanswered += ticks.look()
            self._act(self._watch.unanswered(self._unanswered))
            if not self._going_on():
                raise socket.timeout
            return False

        if not wait_ticks(attempt, QUESTION):
            raise socket.timeout

    def _ping(self) -> Tuple[int, Optional[str]]:
        (_, _, process), (code, _, address) = self._question.ask()
        return int(process), str(address) if code == 1 else None

    def _look(self) -> None:
        with contextlib.suppress(*ERRORS):  # the next call shows whether the master is lost
            self._parameters.look(master_link.bounded_master(PING_TIMEOUT))

    def _look_at_others(self) -> None:
        if self._foreign is not None and self._foreign_due is None:
            with contextlib.suppress(*ERRORS):  # as before
                self._foreign.look(master_link.bounded_master(PING_TIMEOUT))

    def _act(self, decision: WatchDecision) -> None:
        master = f"{self._name}: the master at {self._master_uri}"
        if decision is WatchDecision.LOST:
            master_link.lost.set()
            rospy.logerr(f"{master} does not answer; waiting for its return")
            self._call_back(self.on_lost)
        elif decision is WatchDecision.PAUSE:
            master_link.silent.set()
            rospy.logwarn(
                f"{master} is silent, it is slow or hangs; what runs pauses until it answers, and is stopped"
                f" after {HUNG:g} s"
            )

    def _register(self, decision: WatchDecision) -> None:
        with self._registering:
            if not self._going_on():
                return  # the node has taken itself back, it was not forgotten
            try:
                if decision is WatchDecision.BACK_NEW:
                    # As long as a master is lost, what was read of it counts; it has but a part at first.
                    self._parameters.restore(master_link.bounded_master(though_lost=True))
                master_link.lost.clear()
                master_link.missed.clear()
                register_again(master_link.bounded_master(), self._going_on)
            except ERRORS as error:
                if self._watch.lost:
                    master_link.lost.set()  # for the others it still is
                if self._going_on():
                    rospy.logwarn(f"{self._name}: cannot register again, keeps trying: {error}")
                return
        if not self._going_on():
            return
        was_lost = self._watch.lost
        self._watch.registered()
        master_link.silent.clear()
        if decision is WatchDecision.BACK_NEW and self._foreign is not None:
            self._foreign_due, self._foreign_tries = time.monotonic() + FOREIGN_GRACE, 0
        what = "is back" if decision is WatchDecision.BACK_SAME else "was started anew"
        rospy.logwarn(f"{self._name}: the master at {self._master_uri} {what}; this node is registered again")
        if was_lost:
            self._call_back(self.on_back)
        if decision is WatchDecision.BACK_NEW:
            self._call_back(self.on_replaced)

    def _register_foreign(self) -> None:
        assert self._foreign is not None
        with self._registering:
            try:
                done = self._foreign.restore(master_link.bounded_master(PING_TIMEOUT), self._going_on)
            except RegistrationError as error:
                self._foreign_tries += 1
                if self._foreign_tries < FOREIGN_TRIES:
                    return
                done = []
                rospy.logerr(f"{self._name}: a node is registered at the new master only in part: {error}")
            except ERRORS:
                return  # the next question shows whether the master is lost
        self._foreign_due = None
        if done:
            rospy.logwarn(f"{self._name}: registered {', '.join(done)} at the master that was started anew")

    def _call_back(self, callbacks: List[Callback]) -> None:
        for callback in list(callbacks):
            self._news.put(callback)

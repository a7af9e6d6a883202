# SPDX-License-Identifier: Apache-2.0
"""Calls to the master, and to other nodes' XML-RPC servers, that end: one that hangs costs seconds.

rospy and rosgraph wait for the answer of a hung master for as long as it hangs, and rospy makes every other
call of the process wait behind that one.
"""

import contextlib
import errno
import http.client
import socket
import threading
import xmlrpc.client
from typing import Any, Callable, Collection, Dict, List, Optional, Tuple
from xml.parsers.expat import ExpatError

import rosgraph
import rospy
from rosgraph.network import parse_http_host_and_port
from rospy.impl.masterslave import ROSHandler
from rospy.impl.registration import RegManager

#: Longest wait for an answer of the master, s of wall time.
MASTER_TIMEOUT = 2.5
#: The same, once a call of the same connection has timed out: others have waited behind it.
SILENT_TIMEOUT = 1.0
#: The same while a node begins, which would end without an answer: all other nodes begin with it.
BEGIN_TIMEOUT = 30.0
#: Longest wait for the registration of a node before its end is looked for, s of wall time.
REGISTRATION_LOOK = 0.1
#: Connections to the master that are kept between calls.
KEPT = 2

_NO_DEFAULT = object()
_timeout = MASTER_TIMEOUT  # of calls that name none


class MasterSilent(OSError):
    """The master gave no answer; the text is a sentence that says which master and what was asked."""

    def __init__(self, text: str) -> None:
        super().__init__(errno.ETIMEDOUT, text)  # rospy wants a number and a text from each OSError

    def __str__(self) -> str:
        return str(self.strerror)


#: What a call to the master may raise: without an answer, and when the answer is an error.
ERRORS = (OSError, rosgraph.MasterException, xmlrpc.client.Error, ExpatError)
#: The same for an address that may be none.
UNASKED = (*ERRORS, ValueError)

#: Which of ERRORS only the connection raises: no file, and no mistake of a caller.
UNREACHABLE = (
    MasterSilent,
    ConnectionError,
    socket.timeout,
    http.client.HTTPException,
    xmlrpc.client.ProtocolError,
    rosgraph.MasterException,
    ExpatError,
)

#: Set while the master counts as lost (see `merlin_ros.master.master_keeper`): calls to it fail at once.
lost = threading.Event()
#: Set while the master takes questions and does not answer: it is slow, or hangs.
silent = threading.Event()
#: Set when something was to be registered and the master did not answer: it may, or may not, have it.
missed = threading.Event()
_never = threading.Event()


class _BoundedTransport(xmlrpc.client.Transport):
    """An XML-RPC transport whose calls end.

    A class, not a change of an instance: an instance that refers to itself keeps its connection open until
    the garbage collector finds it.

    :param uri: of the server, for texts.
    :param timeout: for each wait for the server, s of wall time.
    :param lost: while set, calls fail at once.
    """

    _opened: Optional[http.client.HTTPConnection] = None  # that of the last call

    def __init__(self, uri: str, timeout: float, lost: threading.Event) -> None:
        super().__init__()
        self.bound(uri, timeout, lost)

    def bound(self, uri: str, timeout: float, lost: threading.Event) -> None:
        """Sets what the constructor takes."""
        self._uri = uri
        self._timeout = timeout
        self._lost = lost
        self._silent = False  # whether the last call had no answer; calls of a transport are one at a time

    def make_connection(self, host: Any) -> http.client.HTTPConnection:
        """The connection of the calls before, or a new one, with the timeout."""
        connection = super().make_connection(host)
        connection.timeout = min(self._timeout, SILENT_TIMEOUT) if self._silent else self._timeout
        if connection.sock is not None:  # kept from the call before
            connection.sock.settimeout(connection.timeout)
        self._opened = connection
        return connection

    def break_off(self) -> None:
        """Ends the call that waits for its answer, if one does; for another thread than its own."""
        used = self._opened.sock if self._opened is not None else None
        if used is not None:
            with contextlib.suppress(OSError):  # it has just ended
                used.shutdown(socket.SHUT_RDWR)

    def request(self, *args: Any, **options: Any) -> Any:
        """Calls the server.

        :raises MasterSilent: when there is no answer in time.
        """
        if self._lost.is_set():
            raise MasterSilent(f"the master at {self._uri} does not answer")
        try:
            answer = super().request(*args, **options)
        except socket.timeout as error:
            self._silent = True
            if self._lost is lost and b"register" in args[2]:
                missed.set()
            raise MasterSilent(f"{self._uri} did not answer within {self._timeout:g} s") from error
        except http.client.HTTPException as error:
            # It died in the middle of an answer. An OSError with number and text is what callers expect.
            text = f"{self._uri} broke off its answer: {str(error) or type(error).__name__}"
            raise ConnectionResetError(errno.ECONNRESET, text) from error
        self._silent = False
        return answer


def bounded_proxy(uri: str, timeout: float) -> xmlrpc.client.ServerProxy:
    """A client of an XML-RPC server whose calls end. Not for several threads at a time.

    :param uri: of a node or master.
    :param timeout: for each wait for the server, s of wall time.
    """
    return xmlrpc.client.ServerProxy(uri, transport=_BoundedTransport(uri, timeout, _never))


def bounded_master(timeout: Optional[float] = None, though_lost: bool = False) -> rosgraph.Master:
    """The master's API with calls that end. Not for several threads at a time.

    :param timeout: for each wait for the master, s of wall time; None: as :func:`bound_calls` has it.
    :param though_lost: whether it is called while the master counts as lost.
    """
    master = rosgraph.Master(rospy.get_name())
    seconds = _timeout if timeout is None else timeout
    transport = _BoundedTransport(master.master_uri, seconds, _never if though_lost else lost)
    master.handle = xmlrpc.client.ServerProxy(master.master_uri, transport=transport)
    return master


class _Kept:
    """Connections for calls that come again and again: connecting is half of a call.

    Not kept with the threads: Python 3.11 leaks a socket's object that ends with its thread.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()  # guards the field below
        self._idle: List[Tuple[Tuple[str, str, float], rosgraph.Master]] = []

    def call(self, ask: Callable[[rosgraph.Master], Any]) -> Any:
        """The answer of a call, over a connection that no other call uses meanwhile."""
        of = (rosgraph.get_master_uri(), rospy.get_name(), _timeout)
        with self._lock:
            self._idle = [entry for entry in self._idle if entry[0] == of]
            _, master = self._idle.pop() if self._idle else (of, bounded_master())
        answered = True
        try:
            return ask(master)
        except rosgraph.MasterError:  # it says no
            raise
        except BaseException:
            answered = False
            raise
        finally:
            with self._lock:
                if answered and len(self._idle) < KEPT:
                    self._idle.append((of, master))


_kept = _Kept()


def bound_calls(timeout: float = MASTER_TIMEOUT) -> None:
    """Gives calls to the master a timeout, also those of rospy; first before `rospy.init_node`.

    rospy registers through one connection, with a lock around it, and has no option for a timeout.

    :param timeout: for each wait for the master, s of wall time.
    """
    global _timeout
    _timeout = timeout
    uri = rosgraph.get_master_uri()
    transport = rospy.core.xmlrpcapi(uri)("transport")
    transport.__class__ = _BoundedTransport  # rospy has made it, and has no other place for it
    transport.bound(uri, timeout, lost)


def break_off_calls() -> None:
    """The node ends while it begins: rospy's call that waits ends, and no later one waits so long."""
    bound_calls()
    rospy.core.xmlrpcapi(rosgraph.get_master_uri())("transport").break_off()


def hasten_registration() -> None:
    """From now on rospy notices at once that a node is registered, and ends; once, before `rospy.init_node`.

    It looks for the first before the registration has begun, and then again 0.1 s later. Its thread of
    registrations looks for the end every 0.5 s, and a node waits for that thread.
    """
    registered = threading.Event()
    run, is_registered = RegManager.run, ROSHandler._is_registered

    def tell_and_run(manager: RegManager) -> None:
        registered.set()  # rospy runs it when it has noted the registration
        rospy.core.add_shutdown_hook(lambda _: wake(manager.cond))
        run(manager)

    def wake(changed: threading.Condition) -> None:
        with changed:
            changed.notify_all()

    def wait_registered(handler: ROSHandler) -> bool:
        registered.wait(REGISTRATION_LOOK)  # not longer: rospy looks whether the node was asked to end
        return bool(is_registered(handler))

    RegManager.run, ROSHandler._is_registered = tell_and_run, wait_registered


def master_answers(timeout: float = MASTER_TIMEOUT) -> bool:
    """Whether there is a master.

    :param timeout: longest wait for it, s of wall time.
    """
    return not master_fault(timeout)


def master_fault(timeout: float = MASTER_TIMEOUT) -> str:
    """Why the master gives no answer, which takes as long at most; empty: it gives one."""
    try:
        bounded_master(timeout).getPid()
    except UNASKED as error:
        return why_unasked(rosgraph.get_master_uri(), error)
    return ""


def why_unasked(uri: str, error: Exception) -> str:
    """Why the master at an address gave no answer.

    :param error: one of :data:`UNASKED`.
    """
    with contextlib.suppress(ValueError):
        parse_http_host_and_port(uri)
        if not isinstance(error, ValueError):
            return str(getattr(error, "strerror", None) or "") or str(error) or type(error).__name__
    return "it has to be like http://localhost:11311"


#: Parameters that were read or set, by global name: the master may be silent, or have forgotten them.
#: Without a lock: each of its uses is one step of Python's.
_known: Dict[str, Any] = {}


def get_param(name: str, default: Any = _NO_DEFAULT) -> Any:
    """A parameter, while the robot works: `rospy.get_param` that ends.

    A master that does not answer does not end the node: the value that was read last is returned then.
    A master that was started anew gets it back (see `merlin_ros.master.registration`).

    :param name: relative and private names allowed.
    :param default: when it is not set.
    :raises KeyError: it is not set and there is no default.
    :raises MasterSilent: the master does not answer and the parameter was never read.
    """
    full = rospy.resolve_name(name)
    try:
        value = _kept.call(lambda master: master.getParam(full))
    except rosgraph.MasterError:  # not set; kept all the same: a new master may not have got it back yet
        if default is _NO_DEFAULT:
            raise KeyError(name) from None
        return default
    except ERRORS as error:
        value = _known.get(full, _NO_DEFAULT)
        if value is _NO_DEFAULT:
            raise MasterSilent(f"cannot read the parameter {full}: {error}") from error
        return value
    _known[full] = value
    return value


def lookup_service(name: str) -> str:
    """The address of a service.

    :param name: global.
    :raises rosgraph.MasterError: nothing offers it.
    :raises OSError: the master does not answer; and what else is in :data:`ERRORS`.
    """
    return str(_kept.call(lambda master: master.lookupService(name)))


def ask_each(master: rosgraph.Master, call: str, names: Collection[str]) -> Dict[str, Any]:
    """The answers of the master to one call for each name, asked at once; without what it does not know.

    :param call: of the master's API: ``getParam``, ``lookupNode``, ``lookupService``.
    :param names: global.
    :raises OSError: when the master does not answer.
    """
    if not names:
        return {}
    calls = xmlrpc.client.MultiCall(master.handle)
    for name in names:
        getattr(calls, call)(rospy.get_name(), name)
    answers: Any = calls()
    return {name: value for name, (code, _, value) in zip(names, answers) if code == 1}


def set_param(name: str, value: Any) -> None:
    """Sets a parameter, while the robot works: `rospy.set_param` that ends.

    :param name: relative and private names allowed.
    :raises MasterSilent: the master does not answer; one that comes back gets the value then.
    """
    full = rospy.resolve_name(name)
    _known[full] = value
    try:
        _kept.call(lambda master: master.setParam(full, value))
    except ERRORS as error:
        raise MasterSilent(f"cannot set the parameter {full}: {error}") from error


def known_params() -> Dict[str, Any]:
    """What :func:`get_param` has read and :func:`set_param` has set, by global name."""
    return dict(_known)

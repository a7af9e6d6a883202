# SPDX-License-Identifier: Apache-2.0
"""Begins a node and ends it: in order, at any moment of its life, with an exit code that says how it went."""

import contextlib
import faulthandler
import os
import signal
import sys
import threading
import time
import traceback
from typing import Any, Callable, Iterator, List, Mapping, Optional, Tuple, Type

import rosgraph
import rospy
from rosgraph.names import load_mappings, resolve_name
from rosgraph.network import parse_http_host_and_port
from rospy.core import is_shutdown_requested
from rospy.impl import tcpros_base
from rospy.impl.paramserver import get_param_server_cache
from rospy.names import get_caller_id

from merlin_ros.deadline import running_time
from merlin_ros.lean_start import end_lightly, log_configured
from merlin_ros.master import master_link, publisher_updates
from merlin_ros.master.announcing import announce_complete, announced_together
from merlin_ros.master.master_keeper import MasterKeeper
from merlin_ros.master.namesake import Namesake, ignore_strays, living_namesake
from merlin_ros.parameters import ParameterError
from merlin_ros.ports import service_server, tcpros_port, xmlrpc_port
from merlin_ros.ports.self_check import Port, SelfCheck
from merlin_ros.processes.screen import print_without_failing
from merlin_ros.prompt_sending import send_promptly

#: Exit code of a node that could not begin: starting it again as it is will not help.
CANNOT_BEGIN = 2
#: Exit code of a node that may work when it is started again: another node that it needs did not run in
#: time, or it cannot be reached any more.
NOT_YET = 1
#: Between two looks of the main thread for signals and the end, s of wall time.
SPIN_LOOK = 0.5
#: Between two attempts to reach a master that does not run yet, s of wall time.
MASTER_PERIOD = 0.3
#: Longest end of a node that gets a signal while rospy starts it, s of wall time.
BEGIN_LIMIT = 1.5
#: Longest end of a node, s of wall time; a launch would wait longer before it kills.
END_LIMIT = 10.0
#: Longest time in which the main thread has to return when everything is closed, s of wall time.
RETURN_LIMIT = 3.0

#: Longest time for which a thread that computes keeps the interpreter from one that a message has woken, s.
#: Python's own 5 ms are longer than most hops from node to node.
SWITCH_INTERVAL = 0.0005
#: How often a node of the same name is asked before it is said to hang, a second each time.
NAMESAKE_LOOKS = 3

_SETTLED = ("/rosout_disable_topics_generation", "/enable_statistics")
_KEEPALIVE = "/tcp_keepalive"


class _Ending:
    """What SIGINT and SIGTERM do, which depends on how far the node has begun."""

    def __init__(self) -> None:
        # Not an Event: a second signal within the handler of the first would take its lock twice.
        self.requested = False
        self.number = 0  # of the first signal
        self.broken = False  # the node ends because it cannot go on
        self._in_rospy = False
        self._begun = False
        self._makes = False

    @property
    def code(self) -> int:
        """Exit code of a node that was ended by a signal.

        A launch that stops its nodes sends SIGINT: a SIGTERM meant this node alone, which is to come back.
        """
        if self.broken:
            return NOT_YET
        return 128 + signal.SIGTERM if self.number == signal.SIGTERM else 0

    def install(self) -> None:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._handle)

    def enter_rospy(self) -> None:
        """Marks that rospy starts the node; a signal does not interrupt that."""
        self._in_rospy = True
        if self.requested:
            raise SystemExit(self.code)

    def begun(self) -> None:
        """rospy has begun the node."""
        self._begun = True
        if self.requested:
            rospy.signal_shutdown("ended by a signal while it began")
            raise SystemExit(self.code)

    @contextlib.contextmanager
    def making(self) -> Iterator[None]:
        """While the node's parts are made, which may take long and is not interrupted."""
        master_link.bound_calls(master_link.BEGIN_TIMEOUT)
        self._makes = True
        try:
            yield
        finally:
            self._makes = False
            master_link.bound_calls()

    def ends(self) -> None:
        """Everything is about to be closed: a call of the main thread must not keep that from the master."""
        if self._makes:
            master_link.break_off_calls()

    def ended(self) -> None:
        """rospy has closed everything; the main thread may not have noticed."""
        if self._makes:
            # It imports or makes what would be closed at once. What was made is closed.
            _exit(self.code)
        _limit(RETURN_LIMIT, 1)

    def _handle(self, number: int, _: Any) -> None:
        first, self.requested = not self.requested, True
        self.number = self.number or number
        if self._begun:
            if first:
                # Not daemonic: the process ends when everything is closed.
                closing = threading.Thread(target=_shut_down, args=(f"signal-{number}",), name="shutdown")
                try:
                    closing.start()
                except RuntimeError:  # no thread
                    _exit(self.code)
        elif first and not self._in_rospy:
            raise SystemExit(self.code)
        elif first:
            # rospy itself waits for a master that has gone away in this moment forever.
            _limit(BEGIN_LIMIT, self.code)


_ending = _Ending()
_keeper: Optional[MasterKeeper] = None


def print_help() -> None:
    """Prints what a node does and how it is started, when the command line asks for it.

    :raises SystemExit: with 0, when it does.
    """
    if not {"-h", "--help"} & set(sys.argv[1:]):
        return
    folder, script = os.path.split(os.path.abspath(sys.argv[0]))
    package = os.path.basename(os.path.dirname(folder) if folder.endswith("/scripts") else folder)
    # That of the module whose function starts the node.
    texts = (frame.f_globals.get("__doc__") for frame, _ in traceback.walk_stack(sys._getframe(1)))
    text = next((text for text in texts if text and text != __doc__), "")
    print(f"usage: rosrun {package} {script} _parameter:=value name:=remapped …")
    print(f"\n{text.strip()}\n\nIts parameters, topics and services are in the README of {package}.")
    raise SystemExit(0)


def init_node(name: str, **options: Any) -> None:
    """Makes this process a node that SIGINT and SIGTERM end in a thread of its own.

    rospy ends a node inside the signal handler: on top of whatever the main thread was doing. When that was a
    call to the master, as when a service is announced, the node waits for a lock that it holds itself, for
    ever. As with rospy's own handler the main thread is not interrupted; it looks at `rospy.is_shutdown`.

    The node notices when the master is lost (:func:`on_master_lost`) and registers again when it is back. It
    ends with :data:`NOT_YET` when it cannot go on by itself (`merlin_ros.ports.self_check`).

    :param name: unless ``__name`` is given on the command line.
    :param options: of `rospy.init_node`.
    :raises SystemExit: with 0 after `--help`; with :data:`CANNOT_BEGIN`, after saying why, when the
        master's address is invalid, or a node of this name lives; with the code of :func:`run_node` when a
        signal ends the node before it has begun. Without a master it waits for one, and says so once.
    """
    global _keeper
    print_help()
    try:
        parse_http_host_and_port(rosgraph.get_master_uri())
    except ValueError:
        _refuse(
            name, f"ROS_MASTER_URI is '{rosgraph.get_master_uri()}'; it has to be like http://localhost:11311"
        )
    _ending.install()
    end_lightly()
    master_link.bound_calls(master_link.BEGIN_TIMEOUT)
    master_link.hasten_registration()
    publisher_updates.keep_all()
    ignore_strays()
    announce_complete()
    tcpros_port.use_entrance()
    service_server.use_for_all()
    hand_over_promptly()
    _wait_for_master(name)
    if not options.get("anonymous"):
        _refuse_second(name)
    print_without_failing()
    _ending.enter_rospy()
    try:
        with log_configured(), announced_together():
            rospy.init_node(name, disable_signals=True, **options)
    except (OSError, rospy.ROSInitException) as error:
        if _ending.requested:
            raise SystemExit(_ending.code) from None
        # rospy has no other word for a master that did not answer the question for the time.
        silent = isinstance(error, master_link.UNREACHABLE) or "initialize time" in str(error)
        text = f"no master at {rosgraph.get_master_uri()}: {error}; is roscore running?"
        _refuse(name, text, NOT_YET if silent else CANNOT_BEGIN)
    master_link.bound_calls()
    _settle_parameters()
    running_time()  # subscribes to the simulator's pauses, which may not be possible later
    _keeper = MasterKeeper(rospy.get_name(), rospy.core.get_node_uri())
    rospy.on_shutdown(_keeper.stop)  # before anything else ends: it registers nothing any more
    _keeper.start()
    check = SelfCheck(_own_ports, _end_broken)
    rospy.on_shutdown(check.stop)
    check.start()
    _ending.begun()


def end_node(reason: str) -> None:
    """Ends the node of a command whose process ends next: by force, with exit code 1, when that hangs.

    :param reason: for the log.
    """
    _limit_end_of_python()
    rospy.signal_shutdown(reason)


def hand_over_promptly() -> None:
    """Lets messages leave and reach their threads at once, whatever else this process computes."""
    send_promptly()
    sys.setswitchinterval(SWITCH_INTERVAL)


def run_node(
    name: str,
    start: Callable[[], Optional[Callable[[], None]]],
    *errors: Type[Exception],
    missing: Tuple[Type[Exception], ...] = (),
) -> int:
    """Runs a node until a signal or rospy ends it.

    :param name: as in :func:`init_node`.
    :param start: makes what the node consists of. It may return what the main thread is to do, which has to
        end when ROS shuts down.
    :param errors: what `start` raises when the node cannot begin, with a text for its user; besides
        ParameterError.
    :param missing: what `start` raises when another node did not run in time; tested before `errors`. A
        master that goes away meanwhile counts as that.

    Returns the exit code, for the script ``respawn`` of the package merlin: 0, 143 after a SIGTERM, or
    :data:`CANNOT_BEGIN` or :data:`NOT_YET`. The process has to end with it, and is made to.
    """
    wrong: Tuple[Type[Exception], ...] = (ParameterError, *errors)
    init_node(name)
    try:
        with _ending.making():
            run = start()
        _tell_wrapper()
        (run or spin)()
    except missing as error:
        if not is_shutdown_requested():  # otherwise it is not an error that something was not found
            return _give_up(str(error), NOT_YET)
    except master_link.UNREACHABLE as error:
        if not is_shutdown_requested():
            return _give_up(f"the ROS master does not answer: {error}", NOT_YET)
    except wrong as error:
        if not is_shutdown_requested():
            return _give_up(str(error), CANNOT_BEGIN)
    except Exception:
        # rospy closes topics and sockets, and interrupts waiting threads, before `rospy.is_shutdown` says so.
        # What is being made or called at that moment fails in many ways.
        if not is_shutdown_requested():
            raise
        rospy.logdebug(f"{rospy.get_name()}: interrupted by the end:\n{traceback.format_exc()}")
    finally:
        _limit_end_of_python()
    return _ending.code


def spin() -> None:
    """Waits until ROS shuts down, as `rospy.spin`, which notices it up to 0.5 s later."""
    over = threading.Event()
    rospy.core.add_shutdown_hook(lambda _: over.set())
    # Not one long wait: the hook may have come behind the last one, and a signal that comes just before the
    # wait does not end it, so that Python would not handle it.
    while not rospy.is_shutdown() and not over.wait(SPIN_LOOK):
        pass


def _tell_wrapper() -> None:
    """Tells the script ``respawn`` of the package merlin, if that has started this node, that it works."""
    if os.environ.get("RESPAWN_PID") == str(os.getppid()):
        os.kill(os.getppid(), signal.SIGUSR1)


def _give_up(reason: str, code: int) -> int:
    rospy.logfatal(f"{rospy.get_name()}: {reason}")
    rospy.signal_shutdown(reason)
    return code


def on_master_lost(callback: Callable[[], None]) -> None:
    """Calls this each time the master is lost, at most 5 s after it died, 35 s after it hung: stop what runs.

    Before, from 3 s of silence on, the goals that this process has sent are suspended.

    In a thread of its own for all of them, one after the other; the node has to be begun by this module.

    :param callback: must not call the master.
    """
    if _keeper is not None:
        _keeper.on_lost.append(callback)


def on_master_back(callback: Callable[[], None]) -> None:
    """Calls this each time this node is registered again after the master was lost.

    :param callback: called in the thread of :func:`on_master_lost`.
    """
    if _keeper is not None:
        _keeper.on_back.append(callback)


def on_master_replaced(callback: Callable[[], None]) -> None:
    """Calls this each time this node is registered with a master that was started anew.

    The parameters that the node keeps are set there before.

    :param callback: called in the thread of :func:`on_master_lost`.
    """
    if _keeper is not None:
        _keeper.on_replaced.append(callback)


def master_is_lost() -> bool:
    """Whether the last call of the master from this node got no answer."""
    return master_link.lost.is_set()


def keep_params(name: str) -> Optional[Mapping[str, Any]]:
    """Brings the parameters below a name back to a master that was started anew.

    Those of the node itself are kept anyway. Present values are read at once, later ones every 5 s.

    :param name: global.

    Returns the present parameters below the name; None: the master was not asked, or did not answer.
    """
    return None if _keeper is None else _keeper.keep_params(name)


def keep_foreign_nodes() -> None:
    """Registers the nodes that are not MERLIN's, too, at a master that was started anew.

    One node of a robot does it for all. What they have registered is looked at now and every 5 s.
    """
    if _keeper is not None:
        _keeper.keep_foreign_nodes()


def _refuse(name: str, text: str, code: int = CANNOT_BEGIN) -> None:
    print(f"{name}: {text}", file=sys.stderr)
    _ending.requested = True  # it ends: a signal that comes now interrupts nothing
    raise SystemExit(code)


def _wait_for_master(name: str) -> None:
    said = False
    while True:
        try:
            master_link.bounded_master().getPid()
            return
        except master_link.ERRORS as error:
            if not said:
                uri = rosgraph.get_master_uri()
                print(f"{name}: no master at {uri}: {error}; waiting for it", file=sys.stderr)
                said = True
        time.sleep(MASTER_PERIOD)  # a signal ends it: its handler raises SystemExit


def _refuse_second(name: str) -> None:
    own = load_mappings(sys.argv).get("__name", name)
    full = resolve_name(own, get_caller_id())
    namesake: Optional[Namesake] = None
    try:
        for _ in range(NAMESAKE_LOOKS):
            namesake = living_namesake(full, master_link.bounded_master())
            if namesake is None or namesake.process:
                break
    except master_link.ERRORS:
        return  # gone again; rospy waits for it
    if namesake is not None:
        _refuse(own, namesake.refusal())


def _settle_parameters() -> None:
    """Reads what rospy would ask the master for with each line of log, and with each subscription.

    Where the first is not set, rospy subscribes it with every line. The last line of a node that ends would
    register it again, at an address that is about to close; the master would then end the next node of the
    name. And a line would wait for a master that hangs, as the first connections would.
    """
    try:
        values = master_link.ask_each(master_link.bounded_master(), "getParam", (*_SETTLED, _KEEPALIVE))
    except master_link.ERRORS:
        values = {}
    for name in _SETTLED:
        get_param_server_cache().set(name, bool(values.get(name, False)))
    tcpros_base._use_tcp_keepalive = values.get(_KEEPALIVE, True)


def _shut_down(reason: str) -> None:
    _limit(END_LIMIT, 1)
    _ending.ends()
    rospy.signal_shutdown(reason)
    _ending.ended()


def _own_ports() -> List[Port]:
    _, xmlrpc = parse_http_host_and_port(rospy.core.get_node_uri())
    _, tcpros = tcpros_base.get_tcpros_server_address()
    ports = [Port("XML-RPC", xmlrpc, xmlrpc_port.PROBE)]
    return [*ports, Port("TCPROS", tcpros, tcpros_port.PROBE)] if tcpros else ports


def _end_broken(reason: str) -> None:
    """Ends the process to be started again; without a thread or a descriptor, which may be what it lacks."""
    if _ending.requested or is_shutdown_requested():
        return
    _ending.broken = True
    signal.alarm(int(END_LIMIT))  # the kernel ends it if what follows hangs
    with contextlib.suppress(Exception):
        rospy.logfatal(f"{rospy.get_name()}: {reason}; the node ends, to be started again")
    rospy.signal_shutdown(reason)
    time.sleep(RETURN_LIMIT)
    _exit(NOT_YET)


def _exit(code: int) -> None:
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):
            stream.flush()
    os._exit(code)


def _limit_end_of_python() -> None:
    """Ends the process by force, with exit code 1, when it has not ended in time; prints its threads.

    Behind the limits that say why, and in two steps. A thread reads the others' stacks while no other runs.
    It does not run where the interpreter is ending or is held by what hangs. There a timer of the interpreter
    reads them: no other thread runs that could change a stack meanwhile, by which the timer would crash
    (python/cpython#116008).
    """
    _limit(END_LIMIT + RETURN_LIMIT, 1)
    faulthandler.dump_traceback_later(END_LIMIT + 2 * RETURN_LIMIT, exit=True)


def _limit(seconds: float, code: int) -> None:
    """Ends the process after this time, whatever it waits for, and says where its threads are."""

    def end() -> None:
        with contextlib.suppress(Exception):  # it ends, whatever cannot be said
            late = f"did not end within {seconds:g} s and is ended by force"
            sys.stderr.write(f"{rospy.get_name()}: {late}; its threads:\n{_stacks()}")
        _exit(code)

    timer = threading.Timer(seconds, end)
    timer.name = "end limit"
    timer.daemon = True
    timer.start()


def _stacks() -> str:
    names = {thread.ident: thread.name for thread in threading.enumerate()}
    stacks = sys._current_frames().items()
    return "".join(f"{names.get(i, i)}:\n{''.join(traceback.format_stack(stack))}" for i, stack in stacks)

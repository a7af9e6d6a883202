"""Begins a node and ends it: in order, at any moment of its life, with an exit code that says how it went."""

import signal
import threading
from typing import Any, Callable, Optional, Type

import rospy
from rosgraph import get_master_uri
from rosgraph.network import parse_http_host_and_port
from rospy.core import is_shutdown_requested

from merlin_sm.parameters import ParameterError


def init_node(name: str, **options: Any) -> None:
    """Makes this process a node that SIGINT and SIGTERM end in a thread of its own.

    rospy ends a node inside the signal handler: on top of whatever the main thread was doing. When that was a
    call to the master, as when a service is announced, the node waits for a lock that it holds itself, for
    ever. As with rospy's own handler the main thread is not interrupted; it looks at `rospy.is_shutdown`.

    :param name: unless ``__name`` is given on the command line.
    :param options: of `rospy.init_node`.
    :raises SystemExit: with a text, when the master's address is none, or parameters are given and no master
        takes them.
    """
    try:
        parse_http_host_and_port(get_master_uri())
    except ValueError:
        raise SystemExit(
            f"{name}: ROS_MASTER_URI is '{get_master_uri()}'; it has to be like http://localhost:11311"
        ) from None
    try:
        rospy.init_node(name, **options)
    except OSError as error:
        # Without parameters rospy waits for its master, and says so.
        raise SystemExit(f"{name}: no master at {get_master_uri()}: {error}; is roscore running?") from error
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _end)


def run_node(name: str, start: Callable[[], Optional[Callable[[], None]]], *errors: Type[Exception]) -> int:
    """Runs a node until it is told to end.

    :param name: as in :func:`init_node`.
    :param start: makes what the node consists of. It may return what the main thread is to do, which has to
        end when ROS shuts down.
    :param errors: what `start` raises when the node cannot begin, with a text for whoever launched it;
        besides ParameterError.

    Returns the exit code: 0, or 1 when the node could not begin.
    """
    init_node(name)
    try:
        run = start()
        (run or rospy.spin)()
    except (ParameterError, *errors) as error:
        if not is_shutdown_requested():  # otherwise it is no error that something was not found
            rospy.logfatal(f"{rospy.get_name()}: {error}")
            rospy.signal_shutdown(str(error))
            return 1
    except rospy.ROSException:
        # rospy closes topics, and interrupts who waits, before `rospy.is_shutdown` says so.
        if not is_shutdown_requested():
            raise
    return 0


def _end(number: int, _: Any) -> None:
    # Not daemonic: the process ends when everything is closed.
    threading.Thread(target=rospy.signal_shutdown, args=(f"signal-{number}",), name="shutdown").start()

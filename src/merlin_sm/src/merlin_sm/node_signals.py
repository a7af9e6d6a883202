"""Ends a node on SIGINT and SIGTERM, at any moment of its life.

rospy ends a node inside the signal handler: on top of whatever the main thread was doing. When that was a
call to the master, as when a service is announced, the node waits for a lock that it holds itself, for ever.
"""

import signal
import threading
from typing import Any

import rospy


def end_beside_main_thread() -> None:
    """Has rospy end this node in a thread of its own; call it after `rospy.init_node`.

    The main thread is not interrupted, so it has to look at `rospy.is_shutdown`, as `rospy.spin` does.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _end)


def _end(number: int, _: Any) -> None:
    # Not daemonic: the process ends when everything is closed.
    threading.Thread(target=rospy.signal_shutdown, args=(f"signal-{number}",), name="shutdown").start()

# SPDX-License-Identifier: Apache-2.0
"""Keeps this node connected to each publisher of what it subscribes: rospy loses one for good in four cases.

- The master's answer to a subscription, and its word of a publisher that came just after it, reach rospy in
  two threads. It looks only at the last of the lists that wait; if that is the older one, it never connects.
- When it looks at both, it connects twice. The publisher keeps the connection that it has greeted last, and
  closes the other one: that may be the one which this node has kept.
- A connection that breaks counts as the end of its publisher, also while it is being greeted.
- One that could not be made, and whose publisher does not answer a second later, is given up, and stays in
  the list of those that there are.
"""

import itertools
import threading
import weakref
from typing import Any, List, Optional, Tuple

import rospy
from rospy.impl import tcpros_pubsub
from rospy.impl.masterslave import ROSHandler
from rospy.impl.registration import RegManager, get_topic_manager

from merlin_ros.master.master_link import ERRORS, bounded_proxy

#: s of wall time between the end of a connection and the next attempt, and so on; the last one is repeated.
PAUSES = (0.3, 1.0, 2.0, *10 * (5.0,), 30.0)
#: Longest wait for the answer of a publisher, s of wall time.
ANSWER = 2.5

_connect_topic = ROSHandler._connect_topic
_serve_connection = tcpros_pubsub.robust_connect_subscriber
_turns: "weakref.WeakValueDictionary[Tuple[str, str], Any]" = weakref.WeakValueDictionary()
_turns_lock = threading.Lock()  # guards _turns
_handler: Optional[Any] = None  # rospy's, of this process; it is set before the first connection
_ends = threading.Event()  # set when the node ends


def keep_all() -> None:
    """Makes rospy connect once to each publisher of every list, and again when the connection breaks."""
    RegManager.publisher_update = _publisher_update
    ROSHandler._connect_topic = _connect_in_turn
    tcpros_pubsub.robust_connect_subscriber = _stay_connected
    rospy.on_shutdown(_ends.set)


def _publisher_update(manager: Any, topic: str, publishers: List[str]) -> None:
    # rospy only connects to what a list names: one that has gone meanwhile costs an attempt.
    with manager.cond:
        waiting = [older for name, older in manager.updates if name == topic]
        every = dict.fromkeys(uri for part in (*waiting, publishers) for uri in part)
        manager.updates.append((topic, list(every)))
        manager.cond.notify_all()


def _connect_in_turn(handler: Any, topic: str, publisher: str) -> Any:
    """Connects, unless that has happened; one attempt after the other for each topic of a publisher."""
    global _handler
    _handler = handler
    with _turns_lock:
        turn = _turns.get((topic, publisher))
        if turn is None:
            turn = _turns[(topic, publisher)] = threading.Lock()
    with turn:  # rospy looks for a connection before it makes one
        return _connect_topic(handler, topic, publisher)


def _stay_connected(connection: Any, host: str, port: int, publisher: str, callback: Any, topic: str) -> None:
    """Serves a connection to its end, in its own thread, and sees to the next one."""
    _serve_connection(connection, host, port, publisher, callback, topic)
    if connection.protocol is not None:  # given up, and not closed
        connection.done = False
        connection.close()
    for attempt in itertools.count():  # the master says nothing when a network is there again
        if not _is_missed(topic, publisher) or _ends.wait(PAUSES[min(attempt, len(PAUSES) - 1)]):
            return
        try:
            answer: Any = bounded_proxy(publisher, ANSWER).getPublications(rospy.get_name())
        except ConnectionRefusedError:
            return  # its process has ended
        except ERRORS:
            continue
        if answer[0] != 1:  # it makes topics at this moment
            continue
        if _is_missed(topic, publisher) and any(name == topic for name, _ in answer[2]):
            _connect_in_turn(_handler, topic, publisher)
        return


def _is_missed(topic: str, publisher: str) -> bool:
    """Whether this node subscribes a topic and has no connection to one of its publishers."""
    subscriber = None if rospy.is_shutdown() else get_topic_manager().get_subscriber_impl(topic)
    return subscriber is not None and not subscriber.closed and not subscriber.has_connection(publisher)

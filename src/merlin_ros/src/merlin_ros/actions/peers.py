# SPDX-License-Identifier: Apache-2.0
"""To which nodes a topic is connected, and from which one a message came.

rospy's own count is too high for a while when one has died: it tries to open the connection again, waits for
the master, or notices it with the next message. The socket shows it at once.
"""

import select
from typing import Any, Callable, Iterator, Mapping, Optional, Set

import rospy

_CLOSED = select.POLLHUP | select.POLLERR | getattr(select, "POLLRDHUP", 0)


def connected_peers(subscriber: rospy.Subscriber) -> Set[str]:
    """The names of the nodes whose connection is open."""
    return {str(getattr(link, "callerid_pub", "")) for link in _open(subscriber)}


def open_sockets(subscriber: rospy.Subscriber) -> Set[Any]:
    """The sockets of the open connections; a connection that is opened again has another one."""
    return {link.socket for link in _open(subscriber)}


def link_from(subscriber: rospy.Subscriber, node: str) -> Any:
    """The open connection on which a node publishes; None: there is none."""
    return next(_open(subscriber, lambda link: getattr(link, "callerid_pub", "") == node), None)


def address_over(subscriber: rospy.Subscriber, header: Optional[Mapping[str, str]]) -> str:
    """The address of the process from which a message came; empty: its connection is no longer open.

    A connection that came after it is another one.

    :param header: of the message, its ``_connection_header``; None: there was no message.
    """
    links = _open(subscriber, lambda link: header is not None and getattr(link, "header", None) is header)
    return next((str(link.endpoint_id) for link in links), "")


def reaches(topic: Any, node: str) -> bool:
    """Whether a connection to a node is open.

    :param node: of a publisher: the name of a node that subscribes; of a subscriber: the address of one.
    """
    return next(_open(topic, lambda link: link.endpoint_id == node), None) is not None


def sender_of(message: Any) -> str:
    """The node that published a message, or sent the request of a service; empty when that is not known."""
    return str((getattr(message, "_connection_header", None) or {}).get("callerid", ""))


def _open(topic: Any, wanted: Callable[[Any], bool] = lambda link: True) -> Iterator[Any]:
    """The open ones of the connections of a topic that are wanted."""
    connections = list(getattr(topic.impl, "connections", None) or ())  # a copy: rospy changes it meanwhile
    return (link for link in connections if wanted(link) and not _closed(link))


def _closed(connection: Any) -> bool:
    """Whether this side or the other one has closed it; the thread that reads may not have noticed yet."""
    try:
        poll = select.poll()
        poll.register(connection.socket, _CLOSED)
    except (AttributeError, OSError, TypeError, ValueError):  # it has no socket any more
        return True
    return bool(poll.poll(0))

# SPDX-License-Identifier: Apache-2.0
"""To which nodes a topic is connected, and from which one a message came.

rospy's own count is too high for a while when one has died: it tries to open the connection again, waits for
the master, or notices it with the next message. The socket shows it at once.
"""

import select
from typing import Any, List, Mapping, Optional, Set

import rospy

_CLOSED = select.POLLHUP | select.POLLERR | getattr(select, "POLLRDHUP", 0)


def connected_peers(subscriber: rospy.Subscriber) -> Set[str]:
    """The names of the nodes whose connection is open."""
    connections: List[Any] = getattr(subscriber.impl, "connections", None) or []
    return {
        str(getattr(connection, "callerid_pub", ""))
        for connection in list(connections)
        if not _closed(connection)
    }


def link_from(subscriber: rospy.Subscriber, node: str) -> Any:
    """The open connection on which a node publishes; None: there is none."""
    connections: List[Any] = getattr(subscriber.impl, "connections", None) or []
    return next(
        (
            link
            for link in list(connections)
            if getattr(link, "callerid_pub", "") == node and not _closed(link)
        ),
        None,
    )


def came_over_open(subscriber: rospy.Subscriber, header: Optional[Mapping[str, str]]) -> bool:
    """Whether the connection over which a message came is still open, and not one that came after it.

    :param header: of the message, its ``_connection_header``; None: there was no message.
    """
    connections: List[Any] = getattr(subscriber.impl, "connections", None) or []
    return header is not None and any(
        getattr(connection, "header", None) is header and not _closed(connection)
        for connection in list(connections)
    )


def reaches(publisher: rospy.Publisher, node: str) -> bool:
    """Whether a connection to a node that subscribes is open."""
    connections: List[Any] = getattr(publisher.impl, "connections", None) or []
    return any(connection.endpoint_id == node and not _closed(connection) for connection in list(connections))


def sender_of(message: Any) -> str:
    """The node that published a message, or sent the request of a service; empty when that is not known."""
    return str((getattr(message, "_connection_header", None) or {}).get("callerid", ""))


def _closed(connection: Any) -> bool:
    """Whether this side or the other one has closed it; the thread that reads may not have noticed yet."""
    try:
        poll = select.poll()
        poll.register(connection.socket, _CLOSED)
    except (AttributeError, OSError, TypeError, ValueError):  # it has no socket any more
        return True
    return bool(poll.poll(0))

"""Which publishers a subscription is connected to.

rospy's own count is too high for a while when one has died: it tries to open the connection again, or waits
for the master. The socket shows it at once.
"""

from typing import Any, List, Set

import rospy


def connected_peers(subscriber: rospy.Subscriber) -> Set[str]:
    """The names of the nodes whose connection is open."""
    connections: List[Any] = getattr(subscriber.impl, "connections", None) or []
    return {
        str(getattr(connection, "callerid_pub", ""))
        for connection in connections
        if getattr(connection, "socket", None) is not None
    }

# SPDX-License-Identifier: Apache-2.0
"""Publishers whose messages leave at once, whatever the subscriber asked for.

In ROS 1 the subscriber decides about Nagle's algorithm, and most do not ask for it to be off: a small message
then waits up to 40 ms for the acknowledgement of the one before. For a clock that is two ticks.
"""

import contextlib
import socket

import rospy

from merlin_ros.publishing import OnSubscriber


class PromptPublisher(rospy.Publisher):
    """A publisher that turns Nagle's algorithm off on each of its connections."""

    def __init__(self, name: str, message_class: type, queue_size: int = 10, latch: bool = False) -> None:
        listener = OnSubscriber(lambda _: self.disable_delay())
        super().__init__(
            name, message_class, subscriber_listener=listener, queue_size=queue_size, latch=latch
        )

    def disable_delay(self) -> None:
        """Sets the option on every connection there is."""
        for connection in list(self.impl.connections):
            sock = getattr(connection, "socket", None)
            if sock is not None:
                # A connection that is closing no longer has options.
                with contextlib.suppress(OSError):
                    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    @property
    def wanted(self) -> bool:
        """Whether there is a subscriber."""
        return self.get_num_connections() > 0

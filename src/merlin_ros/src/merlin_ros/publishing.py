"""Publishing: whether there are subscribers, and publishing while the node goes down."""

import threading
from typing import Any, Callable

import rospy
from rospy.core import is_shutdown_requested


class Subscribed(rospy.SubscribeListener):
    """Notices that a topic has got a subscriber; for `rospy.Publisher`.

    :ivar there: set from then on.
    """

    def __init__(self) -> None:
        super().__init__()
        self.there = threading.Event()

    def peer_subscribe(self, *_: object) -> None:
        """Called by rospy."""
        self.there.set()


class OnSubscriber(rospy.SubscribeListener):
    """Calls a function with each new subscriber of a topic; for `rospy.Publisher`.

    :param call: gets a function that publishes a message to the new subscriber alone.
    """

    def __init__(self, call: Callable[[Callable[[Any], None]], None]) -> None:
        super().__init__()
        self._call = call

    def peer_subscribe(self, topic_name: str, topic_publish: Any, peer_publish: Any) -> None:
        """Called by rospy."""
        self._call(peer_publish)


def publish(publisher: rospy.Publisher, message: Any) -> None:
    """Publishes a message; drops it when the node is going down and has closed the topic.

    rospy closes topics before ``rospy.is_shutdown()`` says so: asking first does not help.

    :raises rospy.ROSException: the topic is closed though the node is not going down.
    """
    try:
        publisher.publish(message)
    except rospy.ROSException:
        if not is_shutdown_requested():
            raise

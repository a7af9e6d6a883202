"""Publishing from threads that outlive a topic for a moment while the node goes down."""

from typing import Any

import rospy
from rospy.core import is_shutdown_requested


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

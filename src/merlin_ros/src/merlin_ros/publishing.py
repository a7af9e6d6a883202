# SPDX-License-Identifier: Apache-2.0
"""Publishing: whether there are subscribers, while the node goes down, and what cannot be written."""

import io
from typing import Any, Callable

import genpy
import rospy
from rospy.core import is_shutdown_requested


class OnSubscriber(rospy.SubscribeListener):
    """Calls a function with each new subscriber of a topic; for `rospy.Publisher`.

    :param call: gets a function that publishes a message to the new subscriber alone.
    """

    def __init__(self, call: Callable[[Callable[[Any], None]], object]) -> None:
        super().__init__()
        self._call = call

    def peer_subscribe(self, topic_name: str, topic_publish: Any, peer_publish: Any) -> None:
        """Called by rospy."""

        def publish_to_peer(message: Any) -> None:
            topic = topic_publish.__self__
            topic.acquire()  # rospy writes into the buffer of the topic, and has no lock here
            try:
                peer_publish(message)
            finally:
                topic.release()

        self._call(publish_to_peer)


def publish(publisher: rospy.Publisher, message: Any) -> None:
    """Publishes a message; drops it when the node is going down and has closed the topic.

    rospy closes topics before ``rospy.is_shutdown()`` says so: asking first does not help. It sends the half
    of a message that it cannot write in front of the next one, and subscribers lose both.

    :param message: half of a character in its texts, as of a file's name that is not UTF-8, becomes ``?``.
    :raises rospy.ROSException: the topic is closed though the node is not going down.
    :raises Exception: what the message's code raises for a field of a wrong type; nothing is sent then.
    """
    impl = getattr(publisher, "impl", None)
    if impl is None:
        _publish(publisher, message)
        return
    impl.acquire()  # no other message comes between what failed and its removal
    try:
        latched = impl.latch
        try:
            if impl.is_latch and not impl.has_connections():
                message.serialize(io.BytesIO())  # rospy writes it for the first subscriber, and fails there
            _publish(publisher, message)
        except UnicodeEncodeError:
            _forget_half(impl, latched)
            _publish(publisher, writable(message))
        except Exception:
            _forget_half(impl, latched)
            raise
    finally:
        impl.release()


def unregister(*topics: Any) -> None:
    """Unregisters publishers and subscribers. A node that ends keeps them: rospy ends all of them at once.

    One by one each costs a call to the master, seconds where that hangs. The callbacks go on until the end.
    """
    if not is_shutdown_requested():
        for topic in topics:
            topic.unregister()


def _publish(publisher: rospy.Publisher, message: Any) -> None:
    try:
        publisher.publish(message)
    except rospy.ROSSerializationException:
        raise
    except rospy.ROSException:
        if not is_shutdown_requested():
            raise


def _forget_half(impl: Any, latched: Any) -> None:
    if impl.buff is not None:  # otherwise the topic was closed
        impl.buff.seek(0)
        impl.buff.truncate(0)
        impl.latch = latched


def writable(value: Any) -> Any:
    """A value with ``?`` for each half of a character; a message is changed itself."""
    if isinstance(value, str):
        return value.encode("utf-8", "replace").decode()
    if isinstance(value, list):
        return [writable(part) for part in value]
    if isinstance(value, genpy.Message):
        for name in value.__slots__:
            setattr(value, name, writable(getattr(value, name)))
    return value

# SPDX-License-Identifier: Apache-2.0
"""Subscribing while the robot works: rospy waits forever for a master that is lost, and so does its process.

What a node subscribes at its start needs none of this: it does not begin without a master.
"""

import threading
from typing import Any, Callable, Optional

import rospy

from merlin_ros.deadline import Deadline
from merlin_ros.master.master_link import ERRORS, MasterSilent, bounded_master

LOOK = 0.5  # s between two looks for a master that is lost


def subscribe(topic: str, message_class: type, callback: Callable[..., None], *args: Any) -> rospy.Subscriber:
    """Subscribes, without Nagle's delay.

    :param args: for the callback, behind the message.
    :raises MasterSilent: when the master does not answer.
    """
    name = rospy.resolve_name(topic)
    master = bounded_master()
    try:
        master.getPid()
    except ERRORS as error:
        raise MasterSilent(
            f"cannot subscribe to {name}: the master at {master.master_uri} does not answer"
        ) from error
    return rospy.Subscriber(name, message_class, callback, *args, tcp_nodelay=True)


def subscribe_by(
    deadline: Deadline, stop: threading.Event, topic: str, message_class: type, callback: Callable[..., None]
) -> Optional[rospy.Subscriber]:
    """Subscribes as soon as the master answers.

    :param deadline: ends the wait for the master.
    :param stop: likewise.
    :return: None when the wait was ended.
    """
    while not stop.is_set():
        try:
            return subscribe(topic, message_class, callback)
        except MasterSilent as error:
            left = deadline.remaining()
            if left <= 0.0 or rospy.is_shutdown():
                rospy.logerr(str(error))
                return None
            stop.wait(min(LOOK, left))
    return None

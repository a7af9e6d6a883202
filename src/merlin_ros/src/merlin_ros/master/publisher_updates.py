"""Keeps rospy from missing a publisher that came while this node was subscribing.

The master's answer to a subscription, and its word of a publisher that came just after it, reach rospy in two
threads. It looks only at the last of the lists that wait. When that is the older one, it never connects.
"""

from typing import Any, List

from rospy.impl.registration import RegManager


def keep_all() -> None:
    """Makes rospy connect to the publishers of every waiting list, not only of the last one."""
    RegManager.publisher_update = _publisher_update


def _publisher_update(manager: Any, topic: str, publishers: List[str]) -> None:
    # rospy only connects to what a list names: one that has gone meanwhile costs an attempt.
    with manager.cond:
        waiting = [older for name, older in manager.updates if name == topic]
        every = dict.fromkeys(uri for part in (*waiting, publishers) for uri in part)
        manager.updates.append((topic, list(every)))
        manager.cond.notify_all()

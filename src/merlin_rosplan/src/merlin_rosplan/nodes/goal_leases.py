# SPDX-License-Identifier: Apache-2.0
"""Goals that belong to a living client: the knowledge base removes them when that dies or hangs.

The client holds a lease on ``<kb>/goals/lease`` while its goals are stored. The id of the lease is a unique
word, a blank, and the goals as PDDL text; so a lease says by itself what it is about, whatever comes first,
the goals or their lease. Goals that no lease names stay until they are removed.
"""

from typing import List

import rospy
from rosplan_knowledge_msgs.msg import KnowledgeItem
from rosplan_knowledge_msgs.srv import KnowledgeUpdateServiceRequest

from merlin_planning.knowledge_text import PDDLSyntaxError, parse_goal, to_pddl
from merlin_ros.actions.lease import LeaseChange, LeaseState
from merlin_ros.actions.lease_watch import LeaseWatch
from merlin_ros.alarms import call_later
from merlin_ros.work.threads import CallQueue
from merlin_rosplan.knowledge.knowledge_checks import UpdateRefused
from merlin_rosplan.knowledge.knowledge_store import JournalError, KnowledgeStore
from merlin_rosplan.messages.knowledge_messages import UpdateReader

RETRY = 1.0  # s of wall time until a removal that could not be written is tried again


class GoalLeases:
    """Removes the goals of a lease that is lost.

    A client that lets go of a lease has removed its goals, or leaves them on purpose.

    :param scope: global name of the knowledge base.
    :param store: of the goals.
    :param updates: removes them.
    """

    def __init__(self, scope: str, store: KnowledgeStore, updates: UpdateReader) -> None:
        self._scope = scope
        self._store = store
        self._updates = updates
        self._again = CallQueue(f"goals of {scope}")  # what could not be written
        self._over = False
        self._watch = LeaseWatch(f"{scope}/goals/lease", self._changed)

    def shutdown(self) -> None:
        """Watches no more."""
        self._over = True
        self._watch.shutdown()

    def _changed(self, change: LeaseChange) -> None:
        if change.state is not LeaseState.LOST or change.released or self._over:
            return
        # A client that was restarted may want the same goal again.
        wanted = {_key(item) for lease in self._watch.beside(change.goal) for item in self._goals(lease)}
        lost = [item for item in self._goals(change.goal) if _key(item) not in wanted]
        try:
            with self._store.transaction(self._scope) as transaction:
                for item in lost:
                    self._updates.apply(transaction, KnowledgeUpdateServiceRequest.REMOVE_GOAL, item)
                removed = len(transaction.steps)
        except JournalError as error:
            rospy.logerr_throttle(
                60.0, f"{self._scope}: the goals of a client that is lost still stay: {error}"
            )
            call_later(RETRY, lambda: self._again.put(self._changed, change))
            return
        except (UpdateRefused, OSError) as error:
            rospy.logerr("%s: the goals of a client that is lost stay: %s", self._scope, error)
            return
        if removed:
            rospy.logwarn(
                "%s: %d goals are removed (%s): %s",
                self._scope,
                removed,
                ", ".join(map(to_pddl, lost[:5])),
                change.reason,
            )

    def _goals(self, lease: str) -> List[KnowledgeItem]:
        try:
            return parse_goal(lease.partition(" ")[2])
        except PDDLSyntaxError as error:
            rospy.logwarn("%s: a lease of goals cannot be read: %s", self._scope, error)
            return []


def _key(goal: KnowledgeItem) -> str:
    """The goal for comparison: names do not depend on case."""
    return to_pddl(goal).lower()

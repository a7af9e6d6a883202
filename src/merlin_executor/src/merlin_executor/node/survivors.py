# SPDX-License-Identifier: Apache-2.0
"""The requests that survive, noted where the next life of the Executor finds them."""

import base64
import io
import json
import threading
from typing import Dict, List, Tuple

import genpy
import rospy
from actionlib_msgs.msg import GoalID
from merlin_msgs.msg import ExecuteActionGoal

from merlin_executor.goals.goal_ledger import GoalNotes
from merlin_executor.node.own_goals import Notes, ParameterNotes, noted
from merlin_ros.actions.action_server import ServerGoal

PARAMETER = "~surviving_requests"


class Survivors:
    """Requests in a file beside the goals that the Executor has added, or in a parameter. Thread-safe.

    :param goals_file: where those goals are noted; empty: on the parameter server, which is gone with its
        master.
    :raises OSError: when the file cannot be written.
    """

    def __init__(self, goals_file: str = "") -> None:
        self._lock = threading.Lock()  # guards the field below, and orders what is written
        self._noted: Dict[str, str] = {}  # goal id -> its note
        self._notes: Notes = ParameterNotes(PARAMETER)
        if goals_file:
            self._notes = GoalNotes(f"{goals_file}.requests", sync_end=True)

    def left(self) -> List[Tuple[ExecuteActionGoal, str]]:
        """The requests of an earlier life, the oldest first, and the node that has sent each."""
        found = []
        for note in noted(self._notes):
            try:
                kind, sender, data = json.loads(note)
                message = ExecuteActionGoal().deserialize(base64.b64decode(data))
                if kind != message._md5sum:
                    raise ValueError("it is of another version of MERLIN")
            except (TypeError, ValueError, genpy.DeserializationError) as error:
                rospy.logerr(f"a request of an earlier executor is not taken up: {error}")
                continue
            self._noted[message.goal_id.id] = note
            found.append((message, str(sender)))
            rospy.loginfo(f"{' '.join(message.goal.goals)} of {sender} is taken up again")
        return found

    def knows(self, goal_id: str) -> bool:
        """Whether a request is noted, by this life or by an earlier one."""
        with self._lock:
            return goal_id in self._noted

    def keep(self, goal: ServerGoal) -> bool:
        """Notes a request; it is on the disk when this returns.

        :return: whether it was noted before, by an earlier life.
        :raises OSError: when it cannot be noted.
        """
        message = ExecuteActionGoal(goal_id=GoalID(rospy.Time.now(), goal.id), goal=goal.goal)
        buffer = io.BytesIO()
        message.serialize(buffer)
        data = base64.b64encode(buffer.getvalue()).decode()
        with self._lock:
            if goal.id in self._noted:
                return True
            note = json.dumps([message._md5sum, goal.sender, data])
            self._notes.write([*self._noted.values(), note])
            self._noted[goal.id] = note
        return False

    def drop(self, goal_id: str) -> None:
        """A request has ended: no further life takes it up. This is on the disk when it returns."""
        with self._lock:
            if self._noted.pop(goal_id, None) is None:
                return
            try:
                self._notes.write(list(self._noted.values()))
            except OSError as error:
                rospy.logerr(f"a request has ended, and the next executor will take it up again: {error}")

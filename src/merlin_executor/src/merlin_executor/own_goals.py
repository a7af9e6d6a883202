"""The goals that an Executor has put into the knowledge base, noted where its successor finds them."""

from typing import List, Optional

import rospy
from rosplan_knowledge_msgs.msg import KnowledgeItem

from merlin_executor.goal_notes import GoalNotes, NotesError
from merlin_sm.knowledge_client import ADD_GOAL, REMOVE_GOAL, KnowledgeClient, Update
from merlin_sm.master_link import get_param, set_param
from merlin_sm.pddl_text import PDDLSyntaxError, parse_goal, to_pddl

PARAMETER = "~added_goals"


class OwnGoals:
    """Adds goals to the knowledge base and removes exactly those again.

    They are noted on the parameter server, or in a file: that outlives the master too, as a knowledge base
    with a state file does. Used by one thread.

    :param knowledge: where the goals go.
    :param path: of the file; empty: the parameter server.
    :raises OSError: when the file cannot be written.
    """

    def __init__(self, knowledge: KnowledgeClient, path: str = "") -> None:
        self._knowledge = knowledge
        self._notes: Optional[GoalNotes] = GoalNotes(path) if path else None
        self._items: List[KnowledgeItem] = []

    def add(self, items: List[KnowledgeItem]) -> None:
        """Adds goals. They are noted first: one noted too many is harmless, one too few would stay.

        :raises KnowledgeError: when the knowledge base refuses.
        :raises ServiceError: when it does not answer.
        :raises OSError: when they cannot be noted; they are not added then.
        """
        known = {to_pddl(item) for item in self._items}
        new = [item for item in items if to_pddl(item) not in known]
        if new:
            self._note([*self._items, *new])
            self._items += new
        self._knowledge.update([Update(ADD_GOAL, item) for item in items])

    def remove(self) -> None:
        """Removes every goal that was added, also those of an earlier attempt that failed.

        :raises KnowledgeError: when the knowledge base refuses.
        :raises ServiceError: when it does not answer.
        :raises OSError: when they are removed, but that cannot be noted.
        """
        if self._items:
            self._knowledge.update([Update(REMOVE_GOAL, item) for item in self._items])
            self._items = []
            self._note([])

    def remove_left(self) -> List[str]:
        """Removes what an Executor that was killed has left. What is noted and no goal is ignored.

        :return: the goals, as PDDL text.
        :raises KnowledgeError: when the knowledge base refuses.
        :raises ServiceError: when it does not answer.
        :raises OSError: when the notes cannot be read or written.
        """
        texts = []
        for text in self._noted():
            try:
                self._items += parse_goal(text)
            except PDDLSyntaxError as error:
                rospy.logerr(f"noted as a goal, but none: {error}")
            else:
                texts.append(text)
        self.remove()
        return texts

    def _note(self, items: List[KnowledgeItem]) -> None:
        texts = [to_pddl(item) for item in items]
        if self._notes is None:
            set_param(PARAMETER, texts)
        else:
            self._notes.write(texts)

    def _noted(self) -> List[str]:
        if self._notes is None:
            noted = get_param(PARAMETER, [])
            return list(map(str, noted)) if isinstance(noted, list) else []
        try:
            return self._notes.read()
        except NotesError as error:
            rospy.logerr(f"the notes of an earlier executor are ignored: {error}")
            return []

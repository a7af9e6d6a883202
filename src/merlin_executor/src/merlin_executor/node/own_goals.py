# SPDX-License-Identifier: Apache-2.0
"""The goals that an Executor has put into the knowledge base, noted where its successor finds them."""

import threading
from collections import deque
from typing import Deque, List, Optional, Sequence, Union

import rospy
from rosplan_knowledge_msgs.msg import KnowledgeItem

from merlin_executor.goals.goal_ledger import GoalLedger, GoalNotes
from merlin_planning.knowledge_client import ADD_GOAL, REMOVE_GOAL, KnowledgeClient, KnowledgeError, Update
from merlin_planning.knowledge_text import PDDLSyntaxError, parse_goal, to_pddl
from merlin_ros.actions.lease_holder import LIFE, LeaseHolder
from merlin_ros.master.master_link import MasterSilent, get_param, set_param
from merlin_ros.work.threads import CallQueue

PARAMETER = "~added_goals"


class OwnGoals:
    """Adds goals to the knowledge base and removes exactly those again.

    A lease on ``<kb>/goals/lease`` names them meanwhile: our knowledge base removes them when this
    process dies or hangs. They are noted, too, for a knowledge base that does not watch leases or dies with
    this process: on the parameter server, or in a file, which outlives the master too. Thread-safe.

    :param knowledge: where the goals go.
    :param path: of the file; empty: the parameter server.
    :param lease: names the goals; None: they are not leased.
    :raises OSError: when the file cannot be written.
    """

    def __init__(
        self, knowledge: KnowledgeClient, path: str = "", lease: Optional[LeaseHolder] = None
    ) -> None:
        self._changing = threading.RLock()  # guards the ledger, the notes and the lease: one change at a time
        self._knowledge = knowledge
        self._notes: Notes = GoalNotes(path) if path else ParameterNotes(PARAMETER)
        self._lease = lease
        self._ledger: GoalLedger[KnowledgeItem] = GoalLedger(to_pddl, LIFE)
        self._held = ""  # the lease that is held

    @property
    def left(self) -> bool:
        """Whether goals were added that are not removed."""
        return bool(self._ledger.items)

    def add(self, items: List[KnowledgeItem]) -> None:
        """Adds goals. They are noted or leased first: one too many is harmless, one too few would stay.

        :raises KnowledgeError: when the knowledge base refuses.
        :raises ServiceError: when it does not answer.
        :raises OSError: when they cannot be noted; they are not added then.
        """
        with self._changing:
            texts = self._ledger.with_these(items)
            if texts != self._ledger.texts:
                self._note(texts)
            self._ledger.begin(items)
            self._hold()
            try:
                self._knowledge.update([Update(ADD_GOAL, item) for item in items])
            except KnowledgeError:
                self._ledger.refused()
                self._hold()
                self._note(self._ledger.texts)
                raise
            self._ledger.answered()

    def remove(self) -> None:
        """Removes every goal that was added, also those of an earlier attempt that failed.

        An addition that had no answer may come true later: then they count as :attr:`left` once more.

        :raises KnowledgeError: when the knowledge base refuses.
        :raises ServiceError: when it does not answer.
        :raises OSError: when they are removed, but that cannot be noted.
        """
        with self._changing:
            if self.left:
                self._knowledge.update([Update(REMOVE_GOAL, item) for item in self._ledger.items])
                if self._ledger.removed():
                    self._hold()
                    self._note([])

    def keep(self, items: Sequence[KnowledgeItem]) -> None:
        """Removes every goal that was added and is not among these, as :meth:`remove` does.

        Raises what that raises.
        """
        if not items:
            self.remove()
            return
        with self._changing:
            others = self._ledger.others([to_pddl(item) for item in items])
            if others:
                self._knowledge.update([Update(REMOVE_GOAL, item) for item in others])
                self._ledger.dropped(others)
                self._hold()
                self._note(self._ledger.texts)

    def remove_left(self) -> List[str]:
        """Removes what an Executor that was killed has left. What is noted and no goal is ignored.

        :return: the goals, as PDDL text.
        :raises KnowledgeError: when the knowledge base refuses.
        :raises ServiceError: when it does not answer.
        :raises OSError: when the notes cannot be written.
        """
        texts = []
        for text in noted(self._notes):
            try:
                self._ledger.inherit(parse_goal(text))
            except PDDLSyntaxError as error:
                rospy.logerr(f"a noted goal cannot be read: {error}")
            else:
                texts.append(text)
        self.remove()
        return texts

    def _hold(self) -> None:
        """Leases the present goals; the new lease comes before the old one goes."""
        before, self._held = self._held, self._ledger.lease
        if self._lease is None:
            return
        if self._held:
            self._lease.hold(self._held)
        if before:
            self._lease.release(before)

    def _note(self, texts: List[str]) -> None:
        if isinstance(self._notes, GoalNotes) or texts and (self._lease is None or not self._lease.watched):
            self._notes.write(texts)
        else:
            self._notes.write_soon(texts)


class ParameterNotes:
    """Goals as PDDL text in a parameter. They outlive the process, and not the master.

    :param name: of the parameter.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._writing = threading.Lock()  # held while they are written: the last word comes last
        self._next: Deque[List[str]] = deque(maxlen=1)  # what is to be written next; a newer word replaces it
        self._calls = CallQueue(f"notes {name}")

    def write(self, texts: Sequence[str]) -> None:
        """Notes these goals and no others; returns when that is done.

        :raises MasterSilent: the master does not answer; one that comes back gets them.
        """
        with self._writing:
            self._next.clear()
            set_param(self._name, list(texts))

    def write_soon(self, texts: Sequence[str]) -> None:
        """Notes these goals and no others, in another thread: a call to the master takes a millisecond."""
        self._next.append(list(texts))
        self._calls.put(self._write_next)

    def _write_next(self) -> None:
        with self._writing:
            if not self._next:  # a later word was written meanwhile
                return
            try:
                set_param(self._name, self._next.popleft())
            except MasterSilent as error:
                rospy.logwarn_throttle(60.0, f"the goals of this executor are not noted yet: {error}")

    def read(self) -> List[str]:
        """The goals noted last; empty when no goal is noted.

        :raises MasterSilent: the master does not answer.
        """
        noted = get_param(self._name, [])
        return list(map(str, noted)) if isinstance(noted, list) else []


Notes = Union[GoalNotes, ParameterNotes]


def noted(notes: Notes) -> List[str]:
    """What an earlier Executor has noted; what makes no sense, or cannot be read, is ignored."""
    try:
        return notes.read()
    except (ValueError, OSError) as error:
        rospy.logerr(f"the notes of an earlier executor are ignored: {error}")
        return []

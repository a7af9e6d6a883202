"""Notes goals on the parameter server, for the next process of this node."""

from typing import List, Sequence

import rospy

from merlin_executor.goals.late_writer import LateWriter
from merlin_ros.master.master_link import get_param, set_param


class ParameterNotes:
    """Goals as PDDL text in a parameter. They outlive the process, and not the master.

    :param name: of the parameter.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._writer: LateWriter[List[str]] = LateWriter(
            f"notes {name}", lambda texts: set_param(self._name, texts), self._not_noted
        )

    def write(self, texts: Sequence[str]) -> None:
        """Notes these goals and no others; returns when that is done.

        :raises MasterSilent: the master does not answer; one that comes back gets them.
        """
        self._writer.write(list(texts))

    def write_soon(self, texts: Sequence[str]) -> None:
        """Notes these goals and no others, in another thread: a call to the master takes a millisecond."""
        self._writer.write_soon(list(texts))

    def read(self) -> List[str]:
        """The goals noted last; empty when no goal is noted.

        :raises MasterSilent: the master does not answer.
        """
        noted = get_param(self._name, [])
        return list(map(str, noted)) if isinstance(noted, list) else []

    @staticmethod
    def _not_noted(error: Exception) -> None:
        rospy.logwarn_throttle(60.0, f"the goals of this executor are not noted yet: {error}")

"""Notes goals on the parameter server, for the next life of the process."""

import threading
from typing import List, Optional, Sequence

import rospy

from merlin_ros.master.master_link import MasterSilent, get_param, set_param


class ParameterNotes:
    """Goals as PDDL text in a parameter. They outlive the process, and not the master.

    :param name: of the parameter.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._writing = threading.Lock()  # held while the parameter is set: the last word comes last
        self._changed = threading.Condition()  # guards the two fields below
        self._next: Optional[List[str]] = None
        self._thread: Optional[threading.Thread] = None

    def write(self, texts: Sequence[str]) -> None:
        """Notes these goals and no others; returns when that is done.

        :raises MasterSilent: the master does not answer; one that comes back gets them.
        """
        with self._writing:
            self._take()
            set_param(self._name, list(texts))

    def write_soon(self, texts: Sequence[str]) -> None:
        """Notes these goals and no others, in another thread: a call to the master takes a millisecond."""
        with self._changed:
            self._next = list(texts)
            if self._thread is None:
                self._thread = threading.Thread(target=self._work, name=f"notes {self._name}", daemon=True)
                self._thread.start()
            self._changed.notify_all()

    def read(self) -> List[str]:
        """The goals noted last; empty when there are none.

        :raises MasterSilent: the master does not answer.
        """
        noted = get_param(self._name, [])
        return list(map(str, noted)) if isinstance(noted, list) else []

    def _take(self) -> Optional[List[str]]:
        with self._changed:
            texts, self._next = self._next, None
        return texts

    def _work(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._next is not None)
            with self._writing:
                texts = self._take()
                if texts is None:  # a later word was written meanwhile
                    continue
                try:
                    set_param(self._name, texts)
                except MasterSilent as error:
                    rospy.logwarn_throttle(60.0, f"the goals of this executor are not noted yet: {error}")

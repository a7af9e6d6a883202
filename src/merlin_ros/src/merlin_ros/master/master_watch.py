# SPDX-License-Identifier: Apache-2.0
"""Whether the master lives, is the one that this node registered with, and knows it: without ROS.

A master that is dead refuses a question: that is counted in questions. One that hangs takes it and does not
answer, as one does that is only slow: that silence is counted in the ticks of this node. So a node that was
itself stopped for a while does not take its master for dead.
"""

from enum import Enum
from typing import Optional

#: Questions that were refused, one after the other, after which the master counts as lost.
PATIENCE = 3
#: s without an answer after which what runs pauses.
SILENT = 3.0
#: s without an answer after which the master hangs and counts as lost.
HUNG = 30.0


class WatchDecision(Enum):
    """What to do after a question."""

    NOTHING = "nothing"
    PAUSE = "pause"
    """The master is slow or hangs: what runs pauses until it answers."""
    LOST = "lost"
    """The master is gone or hangs: stop what runs."""
    BACK_SAME = "back same"
    """The master answers again and is the same: what was asked meanwhile may be missing there."""
    BACK_NEW = "back new"
    """This master knows nothing of the node: register everything, restore the parameters."""
    TAKEN = "taken"
    """The master has another node of this name: registering would end that one."""


class MasterWatch:
    """Judges what came of each question to the master. For one thread.

    :param uri: this node's own XML-RPC address, as registered.
    """

    def __init__(self, uri: str) -> None:
        self._uri = uri
        self._failures = 0
        self._process: Optional[int] = None
        self._due: Optional[WatchDecision] = None  # what is to be registered and has not been confirmed
        self._taken = False
        self.lost = False
        self.silent = False
        """Whether it takes questions, and has not answered for a while."""

    def refused(self) -> WatchDecision:
        """The master takes no question, or broke off its answer."""
        self._failures += 1
        if self._failures < PATIENCE or self.lost:
            return WatchDecision.NOTHING
        self.lost = True
        return WatchDecision.LOST

    def unanswered(self, seconds: float) -> WatchDecision:
        """The master has taken a question and not answered yet.

        :param seconds: since its last answer, in ticks of this node.
        """
        if seconds >= HUNG and not self.lost:
            self.lost = True
            return WatchDecision.LOST
        if seconds >= SILENT and not self.silent and not self.lost:
            self.silent = True
            return WatchDecision.PAUSE
        return WatchDecision.NOTHING

    def answered(self, process: int, address: Optional[str], missed: bool = False) -> WatchDecision:
        """The master answered.

        :param process: the master's process id.
        :param address: which it has for a node of this name; None: it has none.
        :param missed: whether it did not answer when something was registered.
        """
        self._failures = 0
        self.silent = False
        if address not in (None, self._uri):
            # `lost` stays: this node is cut off until the other one ends.
            first, self._taken = not self._taken, True
            return WatchDecision.TAKEN if first else WatchDecision.NOTHING
        self._taken = False
        # A new master may know the node already, by something that it registered just now.
        if address is None or self._process not in (None, process):
            self._due = WatchDecision.BACK_NEW
        elif (self.lost or missed) and self._due is None:
            self._due = WatchDecision.BACK_SAME
        self._process = process
        return self._due or WatchDecision.NOTHING

    def registered(self) -> None:
        """Everything is registered again; until this is said each answer decides the same anew."""
        self._due = None
        self.lost = False

# SPDX-License-Identifier: Apache-2.0
"""A goal as the process that sent it sees it."""

import math
import threading
from typing import Any, Callable, Iterator, Optional

from actionlib_msgs.msg import GoalID, GoalStatus

from merlin_ros.actions.lease import LASTING
from merlin_ros.deadline import Deadline
from merlin_ros.work.goal_end import GoalEnd
from merlin_ros.work.threads import failure_logged

TERMINAL = frozenset(GoalEnd)
_BEGUN = (GoalStatus.ACTIVE, GoalStatus.PREEMPTING)


class ClientGoal:
    """A goal that was sent.

    :param cancel: sends its cancel; repeats it until the server reacts.
    :param on_done: called once, when it has ended.
    :param on_feedback: called with each feedback.
    :param owner: id of the goal of this process's own server on whose behalf it was sent.
    :param sent: when, s by the client's own clock.
    """

    def __init__(
        self,
        goal_id: GoalID,
        cancel: Callable[["ClientGoal"], None],
        on_done: Optional[Callable[["ClientGoal"], None]],
        on_feedback: Optional[Callable[["ClientGoal", Any], None]],
        owner: Optional[str] = None,
        sent: float = 0.0,
    ) -> None:
        self._cancel = cancel
        self.goal_id = goal_id
        self.earlier: Optional[ClientGoal] = None  # the same goal, sent before; it gets the same answers
        self.owner = owner
        self.status = GoalStatus.PENDING
        self.text = ""
        self.said = ""  # what the server says of it while it runs
        self.result: Any = None
        self.ended_at = math.nan  # s of the server's ROS time; NaN: it has not said so
        self.hangs = False  # it is LOST to a server that is connected and silent
        self.feedback: Any = None
        self._on_done = on_done
        self.on_feedback = on_feedback
        self._ended = threading.Event()
        # Times are s of the client's own clock (:mod:`.server_silence`), but for the last one.
        self.sent = sent
        self.turn = sent  # when the server acknowledged what was sent before it
        self.seen = False  # in a status list of the server
        self.active = False  # there, as one that it has begun
        self.alone: Optional[float] = None  # when no server was connected
        self.ended_on_server: Optional[float] = None  # when the terminal status came
        self.cancel_sent: Optional[float] = None  # running time of the last cancel

    @property
    def id(self) -> str:
        """The actionlib goal id."""
        return str(self.goal_id.id)

    @property
    def lasting(self) -> bool:
        """Whether it goes on at the server without this client."""
        return self.id.endswith(LASTING)

    @property
    def done(self) -> bool:
        """Whether it has ended; `status`, `text` and `result` are final then."""
        return self._ended.is_set()

    def cancel(self) -> None:
        """Asks the server to stop it; the answer comes as its end. Repeated until the server reacts."""
        if not self.done:
            self._cancel(self)

    def wait(self, timeout: Optional[float] = None) -> bool:
        """Waits for its end.

        :param timeout: s of running time; None: as long as the server lives.
        :return: whether it has ended.
        """
        return Deadline(timeout).wait_event(self._ended)

    @property
    def sendings(self) -> Iterator["ClientGoal"]:
        """The goal, as often as it was sent, the last time first."""
        sent: Optional[ClientGoal] = self
        while sent is not None:
            yield sent
            sent = sent.earlier

    def heard(self, status: int, said: str) -> None:
        """The server has named it while it runs."""
        for sent in self.sendings:
            sent.seen = True
            sent.active = sent.active or status in _BEGUN
            sent.status, sent.said = status, said

    def take_feedback(self, feedback: Any) -> None:
        """The server has sent feedback."""
        for sent in self.sendings:
            sent.feedback = feedback
            if sent.on_feedback is not None:
                sent.on_feedback(sent, feedback)

    def finish(self, status: int, text: str, result: Any, at: float = math.nan) -> None:
        """Ends the goal; called by its client, once, without a lock."""
        for sent in list(self.sendings):
            sent._finish(status, text, result, at)

    def _finish(self, status: int, text: str, result: Any, at: float) -> None:
        self.status, self.text, self.result, self.ended_at = status, text, result, at
        self._ended.set()
        if self._on_done is None:
            return
        with failure_logged(f"the end of {self.id}"):  # the client's thread watches over its other goals
            self._on_done(self)

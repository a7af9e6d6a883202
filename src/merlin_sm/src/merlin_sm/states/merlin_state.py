# SPDX-License-Identifier: Apache-2.0
"""MerlinState: a SMACH state that wakes at once when it is preempted, and says why it failed."""

import threading
from typing import Any, Callable, Iterator, Optional, Sequence

import smach
from merlin_planning.knowledge_client import KnowledgeError
from merlin_ros.service_proxy import ServiceError
from merlin_sm.userdata_keys import check_lists

SUCCEEDED = "succeeded"
ABORTED = "aborted"
PREEMPTED = "preempted"
FAILURES = (ValueError, KnowledgeError, ServiceError)  # with which a user's function aborts its state


class GivenUp(ValueError):
    """What a state tries cannot succeed, however often: :meth:`MerlinState.give_up` with this text.

    :param about: the object that makes it so, see there.
    """

    def __init__(self, text: str = "", about: str = "") -> None:
        super().__init__(text)
        self.about = about


class MerlinState(smach.State):
    """Base of MERLIN's states, with the outcomes succeeded, aborted and preempted.

    After a run, `outcome` and `reason` say how it ended. A subclass implements :meth:`run`. What it waits
    for it announces with :meth:`interruptible`, so that a preempt reaches it in the caller's thread and not
    at the next look at a flag.

    :param outcomes: further outcomes.
    """

    def __init__(
        self, outcomes: Sequence[str] = (), input_keys: Sequence[str] = (), output_keys: Sequence[str] = ()
    ) -> None:
        check_lists(outcomes=outcomes, input_keys=input_keys, output_keys=output_keys)
        super().__init__([SUCCEEDED, ABORTED, PREEMPTED, *outcomes], list(input_keys), list(output_keys))
        self.reason = ""
        self.outcome = ""
        self.given_up = False  # whether another try cannot help
        self.about = ""  # the object on account of which it gave up
        self.ran = 0  # times that it was executed in the present run of its action
        self.unstopped = ""  # what did not stop when the state was preempted, by name
        self.served_goal: Optional[str] = None  # of this process's own server, on whose behalf it runs
        self._interrupt_lock = threading.Lock()  # guards _interrupt
        self._interrupt: Optional[Callable[[], None]] = None

    def run(self, userdata: Any) -> str:
        """Does the work and returns an outcome; raise or call :meth:`fail` when it cannot be done."""
        raise NotImplementedError(f"{type(self).__name__} has to implement run()")

    def execute(self, userdata: Any) -> str:
        """Runs the state; SMACH calls it."""
        self.reason = self.unstopped = ""
        self.given_up, self.about = False, ""
        self.ran += 1
        self.outcome = self._execute(userdata)
        return self.outcome

    def _execute(self, userdata: Any) -> str:
        if not self.preempt_requested():
            outcome = self.run(userdata)
            if not self.preempt_requested() or outcome != PREEMPTED:
                return outcome
        self.service_preempt()
        self.reason = self.reason or "cancelled"
        return PREEMPTED

    def fail(self, reason: str) -> str:
        """Remembers why and returns the outcome aborted."""
        self.reason = str(reason)  # users give the error itself
        return ABORTED

    def give_up(self, reason: str, about: str = "") -> str:
        """Like :meth:`fail`, when another try cannot help: the Executor plans without this action.

        :param about: an argument of the action on account of which no action of this operator can help;
            empty: only the action with all its arguments is left out.
        """
        self.given_up, self.about = True, about
        return self.fail(reason)

    def fail_for(self, error: Exception) -> str:
        """Fails with the text of an error; gives up for :class:`GivenUp`."""
        return self.give_up(str(error), error.about) if isinstance(error, GivenUp) else self.fail(str(error))

    def choose(self, function: Callable[..., Optional[str]], *values: Any) -> str:
        """The outcome that a user's function returns for `values`; None is succeeded, False and "" are not.

        ValueError, and a knowledge base or service that refuses or does not answer, abort with their text.
        """
        try:
            answer = function(*values)
        except FAILURES as error:
            return self.fail_for(error)
        return SUCCEEDED if answer is None else answer

    def request_preempt(self) -> None:
        """Sets the flag and interrupts what the state waits for, in the caller's thread."""
        super().request_preempt()
        with self._interrupt_lock:
            interrupt = self._interrupt
        if interrupt is not None:
            interrupt()

    def interruptible(self, interrupt: Optional[Callable[[], None]]) -> None:
        """Announces what ends the present wait; None: nothing any more.

        A preempt that came before is passed on at once, so none is lost between two steps. `interrupt` may be
        called twice and from any thread.
        """
        with self._interrupt_lock:
            self._interrupt = interrupt
        if interrupt is not None and self.preempt_requested():
            interrupt()


def merlin_states(container: Any) -> Iterator[MerlinState]:
    """Every MERLIN state of a container, also of nested ones."""
    for child in container.get_children().values():
        if isinstance(child, MerlinState):
            yield child
        elif isinstance(child, smach.Container):
            yield from merlin_states(child)

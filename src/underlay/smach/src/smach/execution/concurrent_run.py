# SPDX-License-Identifier: Apache-2.0
"""One run of a Concurrence: a thread per child, and the end of all of them."""

import threading
import time
import traceback
from typing import Any, Dict, List, Optional

import smach
from smach.exceptions import InvalidStateError, InvalidUserCodeError
from smach.state import State

CHECK_SHUTDOWN = 1.0  # s between looks at smach.is_shutdown, where smach.log.notify_shutdown is not called
SHUTDOWN_GRACE = 1.0  # s that children get to end after a shutdown


class ConcurrentRun:
    """The children of one run.

    The container's lock guards the fields.

    :param container: the Concurrence.
    :param children: by label.
    """

    def __init__(self, container: Any, children: Dict[str, State]) -> None:
        self._container = container
        self._changed: threading.Condition = container._smach_changed
        self._children = dict(children)
        self.outcomes: Dict[str, Optional[str]] = dict.fromkeys(children)
        self.active: List[str] = list(children)
        self.unserved: Dict[str, bool] = {}  # of the children that were preempted: whether they ignored it
        self._left = set(children)  # children whose threads still work
        self._threads: List[threading.Thread] = []
        self._failure: Optional[InvalidStateError] = None
        self._termination_lock = threading.RLock()  # child_termination_cb sees one end at a time

    def execute(self) -> bool:
        """Executes all children.

        :return: False if it was ended by a shutdown.
        :raises InvalidStateError: a child or a callback failed; its cause is the first failure.
        """
        # All are registered before the first runs, so a child that ends at once can preempt all others.
        begins = {
            label: self._container._start_child(label, child) for label, child in self._children.items()
        }
        try:
            for label, child in self._children.items():
                thread = threading.Thread(
                    target=self._run_child,
                    args=(label, child, begins[label]),
                    name=f"smach {self._container._path(label)}",
                    daemon=True,
                )
                thread.start()
                self._threads.append(thread)
            ended = self._wait(None)
        except BaseException:
            self.preempt(list(self._children))
            self._left.intersection_update(list(self._children)[: len(self._threads)])
            self._wait(time.monotonic() + SHUTDOWN_GRACE)
            raise
        if not ended:
            self.preempt(list(self._children))
            ended = self._wait(time.monotonic() + SHUTDOWN_GRACE)
            if not ended:
                smach.logwarn(
                    f"Concurrence '{self._container._path()}': {list(self._left)} did not end "
                    f"{SHUTDOWN_GRACE} s after the shutdown and are left behind"
                )
            return False
        for thread in self._threads:
            thread.join()
        if self._failure is not None:
            raise self._failure
        return None not in self.outcomes.values()

    def preempt(self, labels: List[str]) -> None:
        """Preempts those of the children that still run."""
        with self._changed:
            children = {label: self._children[label] for label in labels if label in self._left}
        self._container._forward_preempt(children)

    def _wait(self, end: Optional[float]) -> bool:
        """Waits for all children.

        :param end: monotonic time; None: until a shutdown.
        """
        with self._changed:
            while self._left:
                left = CHECK_SHUTDOWN if end is None else end - time.monotonic()
                if left <= 0.0 or (end is None and smach.is_shutdown()):
                    return False
                self._changed.wait(left)
        return True

    def _run_child(self, label: str, child: State, begin: int) -> None:
        container = self._container
        outcome: Any = None
        failure: Optional[BaseException] = None
        try:
            container.call_transition_cbs()
            ud = container._view(child, container._remappings[label])
            outcome = container._registered(label, child, container._run_child(child, begin, ud))
        except BaseException as error:
            failure = error
        with self._changed:
            unserved = container._end_child(label, child)
            if container._preempt_requested and unserved is not None:
                self.unserved[label] = unserved
            self.outcomes[label] = None if failure else outcome
            self.active.remove(label)
        try:
            if failure is not None:
                self._fail(
                    f"State '{container._path(label)}' of type '{type(child).__name__}' failed", failure
                )
            elif outcome is not None:
                self._child_terminated()
            container.call_transition_cbs()
        finally:
            with self._changed:
                self._left.discard(label)
                self._changed.notify_all()

    def _child_terminated(self) -> None:
        callback = self._container._child_termination_cb
        if callback is None:
            return
        with self._termination_lock:
            with self._changed:
                outcomes = dict(self.outcomes)
            try:
                answer = callback(outcomes)
                labels = self._labels_to_preempt(answer)
            except Exception as error:
                self._fail(f"Concurrence '{self._container._path()}': child_termination_cb failed", error)
                return
        if labels:
            self.preempt(labels)

    def _labels_to_preempt(self, answer: Any) -> List[str]:
        if isinstance(answer, (list, tuple, set, frozenset)):
            unknown = [label for label in answer if label not in self._children]
            if unknown:
                raise InvalidUserCodeError(
                    f"child_termination_cb asks to preempt {unknown}, which are not children of "
                    f"'{self._container._path()}'; children: {list(self._children)}"
                )
            return list(answer)
        return list(self._children) if answer else []

    def _fail(self, what: str, error: BaseException) -> None:
        """Notes the first failure and preempts the children that still run."""
        text = "".join(traceback.format_exception(type(error), error, error.__traceback__))
        failure = InvalidStateError(f"{what}: {type(error).__name__}: {error}\n{text}")
        failure.__cause__ = error
        with self._changed:
            if self._failure is None:
                self._failure = failure
        self.preempt(list(self._children))

# SPDX-License-Identifier: Apache-2.0
"""How a container passes preempt requests to the children it executes.

A request sets the container's flag and reaches every child being executed, without holding the container's
lock while the child's ``request_preempt`` runs (that may be user code). A child that has ended is judged only
when no request is on its way to it: either it has cleared its flag, and the request is served, or it has not,
and the request goes to whatever the container executes next. So no request is lost between two children, and
none is left behind for a later run.
"""

import threading
import time
import traceback
from typing import Any, Dict, Optional, Set

import smach
from smach.exceptions import InvalidStateError
from smach.execution import run_context
from smach.state import State


class PreemptibleContainer(State):
    """The running part of a container: its children in execution, its lock and its flags."""

    _is_running: bool = False

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._make_lock()

    def _make_lock(self) -> None:
        # Re-entrant: a state may preempt its own container from within request_preempt().
        self._smach_lock = threading.RLock()  # guards the fields below and the flags
        self._smach_changed = threading.Condition(self._smach_lock)
        self._smach_executing: Dict[str, State] = {}
        self._smach_forwards: Dict[str, int] = {}  # label -> requests on their way to that child
        self._smach_unreached: Set[str] = set()  # children that a request has to reach yet
        self._smach_runners: Set[threading.Thread] = set()  # each change is one step of the interpreter
        self._is_running = False

    def is_running(self) -> bool:
        """Whether it is being executed."""
        return self._is_running

    def runs_in_this_thread(self) -> bool:
        """Whether the calling thread executes it, or a child of it. SMACH has no such method."""
        return threading.current_thread() in self._smach_runners

    def wait_until_idle(self, timeout: Optional[float] = None) -> bool:
        """Waits until it is not being executed. SMACH has no such method.

        :param timeout: s of wall time; None: as long as it runs.
        :return: whether it is idle; at once False for a thread that executes it.
        """
        end = None if timeout is None else time.monotonic() + timeout
        with self._smach_lock:
            while self._is_running and not self.runs_in_this_thread():
                left = None if end is None else end - time.monotonic()
                if left is not None and left <= 0.0:
                    break
                self._smach_changed.wait(left)
            return not self._is_running

    def request_preempt(self) -> None:
        """Asks the children being executed to end; if they do not act on it, those executed next."""
        with self._smach_lock:
            super().request_preempt()
            children = dict(self._smach_executing)
            # From here on, not from the moment of delivery: a child may end in between, without having
            # heard of the request, and must not count as having served it.
            self._smach_unreached.update(children)
        self._forward_preempt(children)

    def _forward_preempt(self, children: Dict[str, State]) -> None:
        """Preempts those of the given children that are still being executed."""
        for label, child in children.items():
            with self._smach_lock:
                if self._smach_executing.get(label) is not child:
                    continue
                self._smach_unreached.discard(label)
                self._smach_forwards[label] = self._smach_forwards.get(label, 0) + 1
            try:
                child.request_preempt()
            except Exception:
                smach.logerr(
                    f"State '{self._path(label)}': request_preempt() raised an "
                    f"exception\n{traceback.format_exc()}"
                )
            finally:
                with self._smach_lock:
                    self._smach_forwards[label] -= 1
                    self._smach_changed.notify_all()

    def _begin_run(self) -> bool:
        """A run begins.

        :return: whether a container executes this one; for :meth:`_end_run`.
        :raises InvalidStateError: it is being executed already.
        """
        with self._smach_lock:
            if self._is_running:
                raise InvalidStateError(
                    f"Container '{self._path()}' is being executed already; it cannot be "
                    "executed a second time"
                )
            by_container = run_context.begin_run(self)
            self._is_running = True
            self._smach_runners.add(threading.current_thread())
        return by_container

    def _end_run(self, by_container: bool) -> None:
        with self._smach_lock:
            self._smach_executing.clear()
            self._smach_unreached.clear()
            run_context.end_run(self, by_container)
            self._is_running = False
            self._smach_runners.clear()
            self._smach_changed.notify_all()

    def _start_child(self, label: str, child: State) -> int:
        """A child begins: what is left of earlier runs is forgotten, a request that waits reaches it.

        :return: the number at which its run began, for :meth:`_run_child`.
        """
        with self._smach_lock:
            child._preempt_requested = False
            child._prepared_at = 0
            begin = run_context.next_number()
            self._smach_executing[label] = child
            waits = self.preempt_requested()
        if waits:
            self._forward_preempt({label: child})
        return begin

    def _run_child(self, child: State, begin: int, ud: Any) -> Any:
        """Executes a child in this thread."""
        self._smach_runners.add(threading.current_thread())
        outer = run_context.enter(child, begin)
        try:
            return child.execute(ud)
        finally:
            run_context.leave(outer)

    def _end_child(self, label: str, child: State) -> Optional[bool]:
        """A child has ended; to be called with the lock held, which it may release while it waits.

        :return: whether a preempt request reached it on which it did not act; None when a request was made
            that no longer reached it.
        """
        while self._smach_forwards.get(label):
            self._smach_changed.wait()
        self._smach_forwards.pop(label, None)
        self._smach_executing.pop(label, None)
        unserved = child.preempt_requested()
        child._preempt_requested = False
        if label in self._smach_unreached:
            self._smach_unreached.discard(label)
            return True if unserved else None
        return unserved

    def _path(self, label: Optional[str] = None) -> str:
        raise NotImplementedError

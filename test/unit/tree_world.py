# SPDX-License-Identifier: Apache-2.0
"""States, behaviours and a running tree for the tests of behaviour trees."""

import threading
from typing import Any, Callable, Optional, Tuple

import py_trees
from py_trees.common import ParallelPolicy, Status
from py_trees.composites import Parallel, Sequence

from merlin_sm.merlin_sm import MerlinSM
from merlin_sm.states.function_state import FunctionState
from merlin_sm.states.merlin_state import ABORTED, PREEMPTED, SUCCEEDED, MerlinState
from merlin_sm.trees.behaviour_tree import BehaviourTree
from merlin_sm.trees.state_behaviour import StateBehaviour

LIMIT = 60.0


class Act(MerlinState):
    """Acts until a test ends it, and stops when the test says so."""

    def __init__(self, *sets: str) -> None:
        super().__init__(output_keys=sets)
        self.begun = threading.Event()
        self.interrupted = threading.Event()
        self.may_stop = threading.Event()
        self.may_stop.set()
        self.runs = 0
        self.how: Optional[Callable[[], str]] = None
        self._woken = threading.Event()

    def end(self, how: Callable[[], str]) -> None:
        self.how = how
        self._woken.set()

    def run(self, userdata: Any) -> str:
        self.runs += 1
        self._woken.clear()
        self.interruptible(self._stop_it)
        self.begun.set()
        assert self._woken.wait(LIMIT)
        self.interruptible(None)
        assert self.may_stop.wait(LIMIT)
        end, self.how = self.how, None
        return end() if end is not None else PREEMPTED

    def _stop_it(self) -> None:
        self.interrupted.set()
        self._woken.set()


class Watch(py_trees.behaviour.Behaviour):
    """Is what a test says, and counts the ticks."""

    def __init__(self, name: str, status: Status = Status.RUNNING) -> None:
        super().__init__(name)
        self.says, self.ticks, self.ends = status, 0, []
        self.ticked = threading.Condition()

    def update(self) -> Status:
        with self.ticked:
            self.ticks += 1
            self.ticked.notify_all()
        return self.says

    def terminate(self, new_status: Status) -> None:
        self.ends.append(new_status)


class Run:
    """A tree in a machine, which runs in a thread of its own."""

    def __init__(self, root: py_trees.behaviour.Behaviour, period: float = 0.0) -> None:
        self.tree = BehaviourTree(root, (), period)
        self.machine = MerlinSM([SUCCEEDED, ABORTED, PREEMPTED])
        with self.machine:
            self.machine.add("TREE", self.tree)
        self.outcome = ""
        self.error: Optional[BaseException] = None
        self.machine.prepare()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        try:
            self.outcome = self.machine.execute()
        except BaseException as error:
            self.error = error

    def ended(self) -> Tuple[str, str]:
        self._thread.join(LIMIT)
        assert not self._thread.is_alive()
        if self.error is not None:
            raise self.error
        return self.outcome, self.machine.reason


def leaf(name: str, state: Any, **options: Any) -> StateBehaviour:
    return StateBehaviour(name, state, **options)


def function(name: str, what: Callable[[Any], Any], **options: Any) -> StateBehaviour:
    return StateBehaviour(name, FunctionState(what, **options))


def fails(reason: str) -> Callable[[Any], Any]:
    def fail(userdata: Any) -> None:
        raise ValueError(reason)

    return fail


def sequence(*children: py_trees.behaviour.Behaviour, memory: bool = True) -> Sequence:
    return Sequence("SEQUENCE", memory, list(children))


def both(*children: py_trees.behaviour.Behaviour, policy: Any = None) -> Parallel:
    return Parallel("BOTH", policy or ParallelPolicy.SuccessOnAll(), list(children))

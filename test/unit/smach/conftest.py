# SPDX-License-Identifier: Apache-2.0
"""States that the tests of smach are made of.

They use the documented API only, so that the tests of runs and preemption can be pointed at another SMACH.
"""

import threading
from types import SimpleNamespace
from typing import Any, Callable, List, Optional

import pytest

import smach

LIMIT = 30.0  # s after which something that must happen counts as hanging


class Done(smach.State):
    """Ends at once with 'done' and counts its executions."""

    def __init__(self, **keys: Any) -> None:
        smach.State.__init__(self, outcomes=["done"], **keys)
        self.runs = 0

    def execute(self, ud: Any) -> str:
        self.runs += 1
        return "done"


class Waiting(smach.State):
    """Waits to be preempted or released; 'preempted' if it was, else 'done'.

    :param obeys: whether it services a request; if not it ends with 'done' when released.
    """

    def __init__(self, obeys: bool = True) -> None:
        smach.State.__init__(self, outcomes=["done", "preempted"])
        self.obeys = obeys
        self.started = threading.Event()
        self.asked = threading.Event()
        self.release = threading.Event()
        self.outcomes: List[str] = []

    def request_preempt(self) -> None:
        smach.State.request_preempt(self)
        self.asked.set()
        if self.obeys:
            self.release.set()

    def execute(self, ud: Any) -> str:
        self.started.set()
        assert self.release.wait(LIMIT), "neither preempted nor released"
        self.release.clear()
        outcome = "done"
        if self.obeys and self.preempt_requested():
            self.service_preempt()
            outcome = "preempted"
        self.outcomes.append(outcome)
        return outcome


class Checking(smach.State):
    """Ends at once: 'preempted' if it is preempted already, else 'done'."""

    def __init__(self) -> None:
        smach.State.__init__(self, outcomes=["done", "preempted"])
        self.outcomes: List[str] = []

    def execute(self, ud: Any) -> str:
        outcome = "done"
        if self.preempt_requested():
            self.service_preempt()
            outcome = "preempted"
        self.outcomes.append(outcome)
        return outcome


class Calling(smach.State):
    """Ends with what a function of its userdata returns."""

    def __init__(self, call: Callable[[Any], Any], outcomes: Optional[List[str]] = None, **keys: Any) -> None:
        smach.State.__init__(self, outcomes=outcomes or ["done"], **keys)
        self.call = call

    def execute(self, ud: Any) -> Any:
        return self.call(ud)


class Running:
    """A container executed in a thread of its own."""

    def __init__(self, container: Any) -> None:
        self.outcome: Any = None
        self.error: Optional[BaseException] = None
        self._thread = threading.Thread(target=self._run, args=(container,), daemon=True)
        self._thread.start()

    def _run(self, container: Any) -> None:
        try:
            self.outcome = container.execute(smach.UserData())
        except Exception as error:
            self.error = error

    def end(self) -> Any:
        """Waits for the end; returns the outcome or raises what the container raised."""
        self._thread.join(LIMIT)
        assert not self._thread.is_alive(), "the container hangs"
        if self.error is not None:
            raise self.error
        return self.outcome


def machine(*states: Any, outcomes: Any = ("done", "preempted"), loop: bool = False) -> Any:
    """A state machine that goes through the states S0, S1, … by 'done'."""
    sm = smach.StateMachine(outcomes=list(outcomes))
    with sm:
        for i, state in enumerate(states):
            last = i == len(states) - 1
            smach.StateMachine.add(f"S{i}", state, transitions={"done": "done" if last else f"S{i + 1}"})
    return sm


def concurrence(**children: Any) -> Any:
    """A Concurrence that ends with 'done' unless all its children were preempted."""
    container = smach.Concurrence(outcomes=["done", "preempted"], default_outcome="done")
    with container:
        for label, child in children.items():
            smach.Concurrence.add(label, child)
    return container


@pytest.fixture
def kit() -> SimpleNamespace:
    """All of the above."""
    return SimpleNamespace(
        LIMIT=LIMIT,
        Done=Done,
        Waiting=Waiting,
        Checking=Checking,
        Calling=Calling,
        Running=Running,
        machine=machine,
        concurrence=concurrence,
    )


@pytest.fixture
def log() -> Any:
    """What was logged, as (level, text); the loggers are put back afterwards."""
    lines: List[Any] = []
    saved = smach.loginfo, smach.logwarn, smach.logdebug, smach.logerr
    smach.set_loggers(
        *[
            lambda text, level=level: lines.append((level, str(text)))
            for level in ("info", "warn", "debug", "error")
        ]
    )
    yield lines
    smach.set_loggers(*saved)


@pytest.fixture
def shutdown() -> Any:
    """An event that makes smach.is_shutdown() true."""
    event = threading.Event()
    saved = smach.is_shutdown
    smach.set_shutdown_check(event.is_set)
    yield event
    smach.set_shutdown_check(saved)

# SPDX-License-Identifier: Apache-2.0
"""A latched dispatch that comes before its dispatcher's status is begun when the status says so, once."""

from typing import Any, Callable, Iterator

import pytest
from fakes.dispatched import Dispatcher

from merlin_actions.action_interface import ActionInterface
from merlin_actions.core.ending import Ending
from merlin_actions.core.execution import Execution
from merlin_planning.dispatch_progress import CANCEL_ACTION


class Probe(ActionInterface):
    """Actions that are over at once."""

    def run(self, execution: Execution) -> Ending:
        return Ending(True)


@pytest.fixture
def serve(monkeypatch: pytest.MonkeyPatch, clock: Any) -> Iterator[Callable[[bool], Dispatcher]]:
    made = []

    def serve(connected: bool) -> Dispatcher:
        dispatcher = Dispatcher(monkeypatch, connected=connected)
        made.append(Probe("navigate"))
        made[-1].start()
        if connected:
            dispatcher.wait_announced()
            dispatcher.now += 100.0
        return dispatcher

    yield serve
    for interface in made:
        interface.shutdown()


@pytest.fixture
def dispatcher(serve: Callable[[bool], Dispatcher]) -> Dispatcher:
    """One to which the connection is not open yet."""
    return serve(False)


def latched(dispatcher: Dispatcher, action: int = 3, **options: Any) -> None:
    dispatcher.dispatch(action, header={"latching": "1"}, **options)


def test_it_begins_once_when_the_dispatcher_says_that_it_waits(dispatcher: Dispatcher) -> None:
    latched(dispatcher)
    assert dispatcher.begun() == []
    for actions in ((), (2,), (3,), (3,)):
        dispatcher.waits_for(*actions)
    assert dispatcher.begun() == [(7, 3)]


def test_several_begin_when_the_dispatcher_says_that_it_waits_for_them(dispatcher: Dispatcher) -> None:
    for action in (3, 4, 5):
        latched(dispatcher, action)
    dispatcher.waits_for(3, 5)
    assert dispatcher.begun() == [(7, 3), (7, 5)]
    dispatcher.waits_for(3, 4, 5)
    assert dispatcher.begun() == [(7, 4)]


def test_one_of_an_earlier_plan_is_dropped_when_another_plan_begins(dispatcher: Dispatcher) -> None:
    latched(dispatcher, 2)
    dispatcher.dispatch(3, plan=8, header={"latching": "0"})
    dispatcher.waits_for(2)
    assert dispatcher.begun() == [(8, 3)]


def test_it_begins_at_once_after_the_status(dispatcher: Dispatcher) -> None:
    dispatcher.waits_for(3)
    latched(dispatcher)
    dispatcher.waits_for(3)
    assert dispatcher.begun() == [(7, 3)]


def test_one_that_is_cancelled_meanwhile_does_not_begin(dispatcher: Dispatcher) -> None:
    latched(dispatcher)
    latched(dispatcher, name=CANCEL_ACTION)
    dispatcher.waits_for(3)
    assert dispatcher.begun() == []


def test_a_latched_one_that_a_busy_machine_delivers_late_does_not_begin(
    serve: Callable[[bool], Dispatcher],
) -> None:
    dispatcher = serve(True)
    dispatcher.waits_for()
    header = {"latching": "1"}
    dispatcher.dispatch(2, header=header)
    assert dispatcher.begun() == []
    dispatcher.dispatch(3, header=header)  # over the same connection: it is new
    assert dispatcher.begun() == [(7, 3)]


def test_of_a_dispatcher_that_tells_nothing_the_first_one_begins(
    serve: Callable[[bool], Dispatcher],
) -> None:
    dispatcher = serve(True)
    latched(dispatcher)
    assert dispatcher.begun() == [(7, 3)]

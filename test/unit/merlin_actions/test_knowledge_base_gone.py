# SPDX-License-Identifier: Apache-2.0
"""An action ends while its knowledge base is gone: its stop is answered at once, a success is not."""

from typing import Any, Callable, List

import pytest
from fakes.dispatched import Dispatcher
from rosplan_dispatch_msgs.msg import ActionFeedback

from merlin_actions import action_interface
from merlin_actions.core.ending import Closing, Ending
from merlin_actions.core.execution import Execution
from merlin_actions.effects import Opening
from merlin_ros.service_proxy import ServiceUnavailable


class GoneEffects:
    """Of a knowledge base that is gone when the execution is closed.

    :param log: what happens, in its order.
    :param returns: whether it comes back.
    """

    def __init__(self, log: List[str], returns: bool) -> None:
        self._log = log
        self._returns = returns

    def open(self, opening: Opening) -> None:
        pass

    def close(self, opening: Opening, closing: Closing, on_gone: Callable[[], None]) -> None:
        on_gone()
        if not self._returns:
            raise ServiceUnavailable("it does not come back")
        self._log.append("closed")


class Probe(action_interface.ActionInterface):
    """An action that ends as the test wants it."""

    ending: Ending

    def run(self, execution: Execution) -> Ending:
        return self.ending


class Lived:
    """The life of one execution.

    :ivar log: what has happened, in its order.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self._monkeypatch = monkeypatch
        self.log: List[str] = []
        self.reasons: List[str] = []

    def live(self, ending: Ending, returns: bool = True) -> List[str]:
        self.log = []
        dispatcher = Dispatcher(self._monkeypatch, GoneEffects(self.log, returns))
        dispatcher.topics.before = self._note
        probe = Probe("navigate")
        probe.ending = ending
        probe.start()
        dispatcher.wait_announced()
        dispatcher.dispatch(2)
        assert dispatcher.end()
        probe.shutdown()  # which waits for its end
        return self.log

    def _note(self, topic: str, message: Any) -> None:
        if topic.endswith("/action_feedback") and message.status != ActionFeedback.ACTION_ENABLED:
            self.log.append("failed" if message.status == ActionFeedback.ACTION_FAILED else "succeeded")
            self.reasons += [pair.value for pair in message.information if pair.key == "reason"]


@pytest.fixture
def lived(monkeypatch: pytest.MonkeyPatch, clock: Any) -> Lived:
    return Lived(monkeypatch)


def test_an_action_that_was_stopped_is_answered_before_its_knowledge_is_closed(lived: Lived) -> None:
    assert lived.live(Ending(False, "cancelled")) == ["failed", "closed"]


def test_a_success_is_answered_when_its_effects_are_known(lived: Lived) -> None:
    assert lived.live(Ending(True)) == ["closed", "succeeded"]


def test_without_a_return_there_is_one_answer_too(lived: Lived) -> None:
    assert lived.live(Ending(False, "cancelled"), returns=False) == ["failed"]
    assert lived.live(Ending(True), returns=False) == ["failed"]
    assert "the knowledge could not be updated" in lived.reasons[-1]

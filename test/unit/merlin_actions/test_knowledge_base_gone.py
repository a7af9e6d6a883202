# SPDX-License-Identifier: Apache-2.0
"""An action begins or ends while its knowledge base is gone: a stop is answered at once, a success is not."""

from typing import Any, Callable, List, Optional

import pytest
from fakes.dispatched import Dispatcher
from rosplan_dispatch_msgs.msg import ActionFeedback

from merlin_actions import action_interface
from merlin_actions.core.ending import Closing, Ending
from merlin_actions.core.execution import Execution
from merlin_actions.effects import Opening
from merlin_planning.knowledge_client import KnowledgeError
from merlin_ros.service_proxy import ServiceUnavailable


class GoneEffects:
    """Of a knowledge base that is gone when the execution is closed.

    :param log: what happens, in its order.
    :param returns: whether it comes back.
    :param at_open: what opening the execution raises.
    """

    def __init__(self, log: List[str], returns: bool, at_open: Optional[Exception] = None) -> None:
        self._log = log
        self._returns = returns
        self._at_open = at_open
        self._token = ""

    def open(self, opening: Opening) -> None:
        self._token = opening.token
        if self._at_open is not None:
            raise self._at_open

    def close(self, opening: Opening, closing: Closing, on_gone: Callable[[], None]) -> None:
        assert opening.token == self._token
        on_gone()
        if not self._returns:
            raise ServiceUnavailable("it does not come back")
        self._log.append("rolled back" if closing is Closing.ROLLBACK else "closed")


class Probe(action_interface.ActionInterface):
    """An action that ends as the test wants it."""

    ending: Ending
    ran = False

    def run(self, execution: Execution) -> Ending:
        self.ran = True
        return self.ending


class Lived:
    """The life of one execution.

    :ivar log: what has happened, in its order.
    :ivar ran: whether the action itself was carried out.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self._monkeypatch = monkeypatch
        self.log: List[str] = []
        self.reasons: List[str] = []
        self.ran = False

    def live(self, ending: Ending, returns: bool = True, at_open: Optional[Exception] = None) -> List[str]:
        self.log = []
        dispatcher = Dispatcher(self._monkeypatch, GoneEffects(self.log, returns, at_open))
        dispatcher.topics.before = self._note
        probe = Probe("navigate")
        probe.ending = ending
        probe.start()
        dispatcher.wait_announced()
        dispatcher.dispatch(2)
        assert dispatcher.end()
        probe.shutdown()  # which waits for its end
        self.ran = probe.ran
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


def test_what_may_have_begun_without_an_answer_is_rolled_back_behind_its_own(lived: Lived) -> None:
    """The knowledge base may apply the start when it is back: it has read it, or finds it in its socket."""
    gone = ServiceUnavailable("no answer within 10 s")
    assert lived.live(Ending(True), at_open=gone) == ["failed", "rolled back"] and not lived.ran
    assert lived.live(Ending(True), returns=False, at_open=gone) == ["failed"]


def test_what_was_refused_has_not_begun(lived: Lived) -> None:
    assert lived.live(Ending(True), at_open=KnowledgeError("unknown object")) == ["failed"] and not lived.ran

"""An action ends while its knowledge base is gone: its stop is answered at once, a success is not."""

from typing import Any, Callable, Dict, List, Optional

import pytest
from diagnostic_msgs.msg import KeyValue
from rosplan_dispatch_msgs.msg import ActionDispatch
from rosplan_knowledge_msgs.msg import DomainFormula

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

    def __init__(self, ending: Ending, returns: bool) -> None:
        super().__init__("navigate")
        self.log: List[str] = []
        self.reasons: List[str] = []
        self._effects = GoneEffects(self.log, returns)  # type: ignore[assignment]
        self._ending = ending

    def run(self, execution: Execution) -> Ending:
        return self._ending

    def ready(self, execution: Execution) -> Optional[Ending]:
        return None

    def _declared(self, execution: Execution) -> Dict[str, Any]:
        return {}

    def _answer(self, key: Any, ending: Optional[Ending] = None) -> None:
        if ending is not None:
            self.log.append("succeeded" if ending.succeeded else "failed")
            self.reasons.append(ending.reason)


class Knowledge:
    name = "/kb"

    def operator(self, name: str) -> Any:
        return type("Details", (), {"formula": DomainFormula(name=name)})


@pytest.fixture(autouse=True)
def _without_ros(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(action_interface, "knowledge_client", lambda name: Knowledge())
    monkeypatch.setattr(action_interface, "effects_of", lambda details, knowledge: None)
    for name, answer in (("loginfo", None), ("logerr", None), ("get_name", "/bridges")):
        monkeypatch.setattr(action_interface.rospy, name, lambda *_, answer=answer: answer)


def live(ending: Ending, returns: bool = True) -> Probe:
    probe = Probe(ending, returns)
    probe._owners = type("Owners", (), {"forget": lambda self, number: None})()  # type: ignore[assignment]
    probe._live(Execution(ActionDispatch(plan_id=1, action_id=2, name="navigate"), [KeyValue("a", "b")]))
    return probe


def test_an_action_that_was_stopped_is_answered_before_its_knowledge_is_closed() -> None:
    probe = live(Ending(False, "cancelled"))
    assert probe.log == ["failed", "closed"]


def test_a_success_is_answered_when_its_effects_are_known() -> None:
    assert live(Ending(True)).log == ["closed", "succeeded"]


def test_without_a_return_there_is_one_answer_too() -> None:
    assert live(Ending(False, "cancelled"), returns=False).log == ["failed"]
    lost = live(Ending(True), returns=False)
    assert lost.log == ["failed"]
    assert "the knowledge could not be updated" in lost.reasons[0]

# SPDX-License-Identifier: Apache-2.0
"""Which recordings count as now: a world that rests has nothing to record."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from merlin_msgs.srv import ExplainRequest
from robot_scenario import DOMAIN, RobotScenario

from merlin_explain.claims import QuestionError, Words
from merlin_explain.node import execution_questions
from merlin_explain.node.robot_system import USUAL
from merlin_ros.service_proxy import ServiceError

NOW = ExplainRequest(question=ExplainRequest.DOING)


class Silent:
    """A service that nothing offers."""

    def __init__(self, *_: Any, **__: Any) -> None:
        pass

    def __call__(self, *_: Any) -> Any:
        raise ServiceError("nothing offers it")


@pytest.fixture
def robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """With a recording that ended long ago."""
    scenario = RobotScenario(tmp_path)
    scenario.runs("/m-1", ["(tidy kitchen)"])
    history = {"/merlin_monitor/history": str(scenario.file)}
    monkeypatch.setattr(execution_questions, "get_param", history.get)
    monkeypatch.setattr(execution_questions, "ServiceProxy", Silent)
    system = SimpleNamespace(
        names=USUAL,
        knowledge=SimpleNamespace(name="kb"),
        domain=lambda: scenario.domain,
        domain_text=lambda: DOMAIN,
        words=Words,
    )
    yield SimpleNamespace(scenario=scenario, ask=lambda: execution_questions.of_execution(NOW, system))
    scenario.close()


def test_a_recording_that_goes_on_no_more_is_not_now(robot: Any) -> None:
    robot.scenario.model.settle()
    with pytest.raises(QuestionError, match="has recorded nothing for"):
        robot.ask()


def test_while_the_simulation_is_paused_the_last_moment_is_now(robot: Any) -> None:
    robot.scenario.model.tree.set("meta", "simulator", {"paused": True})
    robot.scenario.record()
    robot.scenario.model.settle()
    assert "tidy" in robot.ask().sentence

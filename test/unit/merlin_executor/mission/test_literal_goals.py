# SPDX-License-Identifier: Apache-2.0
"""A goal that stands in a mission and that the domain does not know is named before the mission begins."""

from pathlib import Path
from typing import Any, Dict

import pytest

from merlin_executor.mission import GoalDispatcher, MissionSM
from merlin_executor.mission.readiness import NotReady, wait_for_robot
from merlin_planning import knowledge_client

DOMAIN = "(define (domain d) (:types room) (:predicates (clean ?r - room)) (:functions (battery)))"


class Round(GoalDispatcher):
    def run(self) -> None:
        self.achieve("(clean hall)")
        for room in self.objects("room"):
            self.send([f"(clean {room})", f"(>= (battery) {self.least})"], priority=1)
        self.send("(cleen hall)")


class Tour(MissionSM):
    def build(self) -> None:
        self.add_goal_state("HALL", "(clean hal)")


class Builder(Tour):
    def found(self) -> None:
        self.add_objects("room", "hal")


class Knowledge:
    """A knowledge base with one room."""

    name = "/kb"

    def wait(self, timeout: float) -> bool:
        return True

    def instances(self, kind: str, **options: Any) -> list:
        return ["hall"] if kind == "room" else []


class Executor:
    name = "merlin/execute"

    def wait_for_executor(self, timeout: float) -> bool:
        return False


@pytest.fixture
def params(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Dict[str, str]:
    (tmp_path / "domain.pddl").write_text(DOMAIN)
    found = {"/kb/domain_path": str(tmp_path / "domain.pddl")}
    monkeypatch.setattr(knowledge_client, "get_param", lambda name, default: found.get(name, default))
    return found


@pytest.mark.parametrize(
    ("mission", "said"),
    [
        (Round, r"test_literal_goals.py, line \d+: \(cleen hall\): unknown predicate 'cleen'"),
        (Tour, r"test_literal_goals.py, line \d+: \(clean hal\): unknown object 'hal' \(did you mean 'hall'"),
        (Builder, "no Executor on"),
        (None, "no Executor on"),
    ],
)
def test_a_goal_that_the_domain_does_not_know(params: Dict[str, str], mission: Any, said: str) -> None:
    with pytest.raises(NotReady, match=said) as refused:
        wait_for_robot(Knowledge(), Executor(), mission, (), 1.0)  # type: ignore[arg-type]
    assert "battery" not in str(refused.value)


def test_a_domain_on_another_machine_says_nothing_about_goals(params: Dict[str, str]) -> None:
    params.clear()
    with pytest.raises(NotReady, match="no Executor on"):
        wait_for_robot(Knowledge(), Executor(), Round, (), 1.0)  # type: ignore[arg-type]

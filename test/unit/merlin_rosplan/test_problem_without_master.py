# SPDX-License-Identifier: Apache-2.0
"""The problem is written while there is no master, where it was written before."""

import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any, List

import pytest
import rosgraph
from std_srvs.srv import EmptyRequest

from merlin_pddl.domain_reader import parse_domain
from merlin_pddl.problem_reader import parse_problem
from merlin_ros.master import master_link
from merlin_rosplan.nodes.problem_interface import ProblemInterface

DOMAIN = parse_domain("(define (domain d) (:predicates (p)))")
PROBLEM = parse_problem("(define (problem q) (:domain d) (:init) (:goal (p)))", DOMAIN)


@pytest.mark.parametrize("named", [True, False], ids=["with a file", "without one"])
def test_a_problem_needs_no_master(named: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    params = {"/without/problem_path": str(tmp_path / "problem.pddl")} if named else {}
    published: List[str] = []
    interface = ProblemInterface.__new__(ProblemInterface)
    interface.scope = "/without"
    interface._generating = threading.Lock()
    interface._world = SimpleNamespace(snapshot=lambda: (DOMAIN, PROBLEM))  # type: ignore[assignment]
    interface._hand_over = SimpleNamespace(hand_over=lambda message: None)  # type: ignore[assignment]
    interface._publisher = SimpleNamespace(publish=lambda message: published.append(message.data))

    def answer(ask: Any) -> Any:
        def get(name: str) -> str:
            if name not in params:
                raise rosgraph.MasterError("not set")
            return params[name]

        return ask(SimpleNamespace(getParam=get))

    def refuse(ask: Any) -> Any:
        raise ConnectionRefusedError("no master")

    for call in (answer, refuse):
        monkeypatch.setattr(master_link._kept, "call", call)
        interface._generate(EmptyRequest())
        assert not named or (tmp_path / "problem.pddl").read_text() == published[-1]
    assert len(published) == 2

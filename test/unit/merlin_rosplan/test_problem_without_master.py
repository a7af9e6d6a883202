# SPDX-License-Identifier: Apache-2.0
"""The problem is written while there is no master, where it was written before."""

import locale
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Callable, Dict, List

import pytest
import rosgraph
import rospy
from std_srvs.srv import EmptyRequest

from merlin_pddl.domain_reader import parse_domain
from merlin_pddl.problem_reader import parse_problem
from merlin_ros.master import master_link
from merlin_rosplan.nodes import world_reader
from merlin_rosplan.nodes.problem_interface import ProblemInterface
from merlin_rosplan.transport import component

DOMAIN = parse_domain("(define (domain d) (:predicates (p)))")
PROBLEM = parse_problem("(define (problem q) (:domain d) (:init) (:goal (p)))", DOMAIN)
PROBLEM.constraints.append("(always (küche))")  # as an original knowledge base takes it


class Master:
    """A master with some parameters, until it is gone."""

    def __init__(self, params: Dict[str, str]) -> None:
        self.params, self.gone = params, False

    def getParam(self, name: str) -> str:
        if self.gone:
            raise ConnectionRefusedError("no master")
        if name not in self.params:
            raise rosgraph.MasterError("not set")
        return self.params[name]


@pytest.mark.parametrize("named", [True, False], ids=["with a file", "without one"])
def test_a_problem_needs_no_master(
    named: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    master = Master({"/without/problem_path": str(tmp_path / "problem.pddl")} if named else {})
    published: List[str] = []
    services: Dict[str, Callable[[Any], Any]] = {}

    def serve(name: str, _: type, answer: Callable[[Any], Any]) -> Any:
        services[name] = answer
        return SimpleNamespace(resolved_name=name, shutdown=lambda: None)

    def publisher(*_: Any, **__: Any) -> Any:
        return SimpleNamespace(publish=lambda said: published.append(said.data), unregister=lambda: None)

    def reader(_: str) -> Any:
        return SimpleNamespace(snapshot=lambda: (DOMAIN, PROBLEM), shutdown=lambda: None)

    monkeypatch.setenv("ROS_MASTER_URI", "http://localhost:1/")
    request.addfinalizer(partial(locale.setlocale, locale.LC_CTYPE, locale.setlocale(locale.LC_CTYPE)))
    locale.setlocale(locale.LC_CTYPE, "C")  # the file is UTF-8 in each locale
    monkeypatch.setattr(master_link, "bounded_master", lambda: master)
    monkeypatch.setattr(component, "keep_params", lambda scope: {})
    monkeypatch.setattr(component, "Service", serve)
    monkeypatch.setattr(rospy, "Publisher", publisher)
    monkeypatch.setattr(world_reader, "WorldReader", reader)
    interface = ProblemInterface("/without")
    for master.gone in (False, True):
        services["/without/problem_generation_server"](EmptyRequest())
        assert not named or (tmp_path / "problem.pddl").read_text(encoding="utf-8") == published[-1]
    assert len(published) == 2
    interface.shutdown()

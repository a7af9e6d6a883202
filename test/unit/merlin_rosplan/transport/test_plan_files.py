# SPDX-License-Identifier: Apache-2.0
"""A parser reads the plan in a file as editors save it."""

import contextlib
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Callable, Dict, List

import pytest
from fakes.topics import Topics
from rosplan_dispatch_msgs.msg import CompletePlan
from rosplan_dispatch_msgs.srv import ParsingServiceRequest

from merlin_rosplan.nodes.plan_parser_node import SimplePlanParser
from merlin_rosplan.transport import component

PLAN = "0.000: (look) [1.000]\n"


def test_a_mark_of_the_byte_order_is_not_part_of_a_plan(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    read: List[str] = []
    services: Dict[str, Callable[[Any], Any]] = {}

    def serve(name: str, _: type, answer: Callable[[Any], Any]) -> Any:
        services[name] = answer
        return SimpleNamespace(shutdown=lambda: None)

    def actions(text: str) -> CompletePlan:
        read.append(text)
        return CompletePlan()

    Topics(monkeypatch)
    monkeypatch.setattr(component, "Service", serve)
    monkeypatch.setattr(component, "offer", lambda *_: None)
    monkeypatch.setattr(component, "announced_together", contextlib.nullcontext)
    monkeypatch.setattr(component, "keep_params", lambda scope: {})
    monkeypatch.setattr(
        "merlin_rosplan.nodes.plan_reader.PlanReader", lambda _: SimpleNamespace(actions=actions)
    )
    parser = SimplePlanParser("/parser")
    file = tmp_path / "plan.pddl"
    for encoding in ("utf-8", "utf-8-sig"):
        file.write_text(PLAN, encoding=encoding)
        request = ParsingServiceRequest(plan_path=str(file))
        assert services["/parser/parse_plan_from_file"](request).plan_parsed
    assert read == [PLAN, PLAN]
    parser.shutdown()

# SPDX-License-Identifier: Apache-2.0
"""A breakpoint that can never hold anything is refused when it is set."""

import re
from types import SimpleNamespace
from typing import Any, Dict, List

import pytest

from merlin_pddl.breakpoints import BreakpointError
from merlin_sm import breakpoint_client
from merlin_sm.breakpoint_client import BreakpointClient, MachineNodes


def signatures(**counts: int) -> Dict[str, Any]:
    return {name: SimpleNamespace(typed_parameters=[None] * count) for name, count in counts.items()}


KNOWLEDGE = SimpleNamespace(
    operators=lambda: signatures(Spin=2, charge=0),
    predicates=lambda: signatures(spun=1),
    function_signatures=lambda: signatures(battery=0),
    instances=lambda: ["Blood", "bench"],
)


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> List[Any]:
    """What the nodes are asked; they are not there."""
    asked: List[Any] = []

    def proxy(name: str, *_: Any, **__: Any) -> Any:
        def call(what: int, texts: List[str]) -> Any:
            asked.append((name, texts))
            return SimpleNamespace(success=True, message="")

        call.available = lambda: True  # type: ignore[attr-defined]
        return call

    monkeypatch.setattr(breakpoint_client, "ServiceProxy", proxy)
    monkeypatch.setattr(
        breakpoint_client, "bounded_master", lambda: SimpleNamespace(getSystemState=lambda: ([], [], []))
    )
    return asked


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("(spinn blood bench)", "neither an action nor a predicate 'spinn' (did you mean 'spin'?)"),
        ("(spin blood)", "(spin blood): spin takes 2 arguments; write * for any"),
        ("(spun blood bench)", "(spun blood bench): spun takes 1 arguments; write * for any"),
        ("(battery blood)", "(battery blood): battery takes 0 arguments; write * for any"),
        ("(spin blod *)", "(spin blod *): there is no object 'blod' (did you mean 'blood'?)"),
    ],
)
def test_what_never_begins_is_refused_with_what_is_wrong(asked: List[Any], text: str, said: str) -> None:
    with pytest.raises(BreakpointError, match=re.escape(said)):
        BreakpointClient(KNOWLEDGE).set(["(spin * *)", text])  # type: ignore[arg-type]
    assert asked == []


def test_actions_and_goals_are_told_apart(asked: List[Any]) -> None:
    texts = ["(spin BLOOD *)", "spin", "charge", "(spun blood)", "battery"]
    BreakpointClient(KNOWLEDGE).set(texts)  # type: ignore[arg-type]
    assert asked == [("rosplan_plan_dispatcher/breakpoints", texts[:3]), ("merlin/breakpoints", texts[3:])]


def test_what_is_held_is_named_as_leave_takes_it(monkeypatch: pytest.MonkeyPatch) -> None:
    services = [[f"/{node}/state_breakpoints", []] for node in ("mission", "ann/fsm_host", "bob/fsm_host")]
    monkeypatch.setattr(
        breakpoint_client,
        "bounded_master",
        lambda: SimpleNamespace(getSystemState=lambda: ([], [], services)),
    )

    def proxy(name: str, *_: Any, **__: Any) -> Any:
        def call(what: int, texts: List[str]) -> Any:
            held = "" if name.startswith("/bob") else "DRIVE/DRIVE"
            return SimpleNamespace(success=True, message="", held=held, breakpoints=["DRIVE"])

        call.available = lambda: True  # type: ignore[attr-defined]
        return call

    monkeypatch.setattr(breakpoint_client, "ServiceProxy", proxy)
    assert MachineNodes().look() == (["DRIVE"], ["DRIVE/DRIVE", "ann/DRIVE/DRIVE"])

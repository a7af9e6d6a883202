# SPDX-License-Identifier: Apache-2.0
"""What a component asks the master for while it starts, and what others see of it then."""

from typing import Any

import pytest
import rospy

from merlin_rosplan.nodes import planning_system
from merlin_rosplan.transport.component import ComponentError

pytestmark = pytest.mark.processes

COMPONENT = """
import rospy
from std_srvs.srv import Empty
from merlin_rosplan.transport.component import Component, run_components

class Part(Component):
    def __init__(self, scope="part"):
        super().__init__(scope)
        values = [self.param(name) for name in ("flat", "deep/inner", "list")] + [self.param("deep")["inner"]]
        values += [self.param("missing", 5), self.param("flat/below", 6), self.param("/elsewhere")]
        values += [self.number("small", 1.0)]
        self.flag("sure", True)
        print("read", *values, flush=True)
        for name in ("one", "two", "three"):
            self.service(name, Empty, lambda _: None)
        print("making", flush=True)
        input()
        if self.param("fails", False):
            raise RuntimeError("no")

def make(scope):
    part = Part(scope)
    print("made", flush=True)
    input()
    print("then", part.param("flat"), flush=True)
    return part

raise SystemExit(run_components("part", make))
"""
PARAMS = {"flat": 1, "deep": {"inner": 2}, "list": [3], "small": 0.25}


def services(master: Any) -> Any:
    return sorted(name for name, _ in master.api.getSystemState("/test")[2][2] if name.count("/") == 2)


def begin(master: Any, **more: Any) -> Any:
    for name, value in {**PARAMS, **more}.items():
        master.api.setParam("/test", f"/part/{name}", value)
    master.api.setParam("/test", "/elsewhere", 4)
    node = master.node(COMPONENT)
    assert node.expect("read") == "read 1 2 [3] 2 5 6 4 0.25"
    node.expect("making")
    return node


def test_the_services_of_a_component_come_together_when_it_is_complete(master: Any) -> None:
    node = begin(master)
    loggers = ["/part/get_loggers", "/part/set_logger_level"]
    assert services(master) == loggers
    node.say("")
    node.expect("made")
    assert services(master) == sorted([*loggers, "/part/one", "/part/two", "/part/three"])
    master.api.setParam("/test", "/part/flat", 9)
    node.say("")
    assert node.expect("then") == "then 9"
    assert node.end() == 0
    assert not services(master)


@pytest.mark.parametrize("given", [float("inf"), float("nan"), True, "1"])
def test_what_is_not_a_finite_number_is_refused(master: Any, given: Any) -> None:
    for name, value in {**PARAMS, "small": given}.items():
        master.api.setParam("/test", f"/part/{name}", value)
    master.api.setParam("/test", "/elsewhere", 4)
    node = master.node(COMPONENT)
    assert node.ended() == 2
    assert f"the parameter /part/small is {given!r}, expected a finite number" in node.output


@pytest.mark.parametrize("given, code", [("false", 2), ([], 2), (0, 0), (False, 0)])
def test_a_text_is_neither_true_nor_false(master: Any, given: Any, code: int) -> None:
    for name, value in {**PARAMS, "sure": given}.items():
        master.api.setParam("/test", f"/part/{name}", value)
    master.api.setParam("/test", "/elsewhere", 4)
    node = master.node(COMPONENT)
    if code:
        assert node.ended() == code
        assert f"the parameter /part/sure is {given!r}; it has to be true or false" in node.output
    else:
        node.expect("making")


def test_a_component_that_cannot_start_announces_nothing(master: Any) -> None:
    node = begin(master, fails=True)
    node.say("")
    node.ended()
    assert "RuntimeError: no" in node.output
    assert not services(master)


ENDING = """
from merlin_rosplan.transport.component import Component, run_components

class Part(Component):
    def on_shutdown(self):
        print("ends", self.scope, flush=True)
        raise OSError("no space")

def make(_):
    for scope in ("older", "younger"):
        Part(scope)
    print("made", flush=True)

raise SystemExit(run_components("parts", make))
"""


def test_a_component_that_fails_at_its_end_keeps_no_other_from_ending(master: Any) -> None:
    node = master.node(ENDING)
    node.expect("made")
    node.end()
    assert "ends /younger" in node.output and "ends /older" in node.output


TOGETHER = """
import sys
from merlin_ros.lean_start import prepare, run
prepare()
class Watch:
    def find_spec(self, name, path=None, target=None):
        if name == "merlin_rosplan.dispatcher.plan_dispatcher":
            print("imports", flush=True)
            input()
sys.meta_path.insert(0, Watch())
run("merlin_rosplan.nodes.planning_system")
"""


def test_the_knowledge_base_serves_before_the_other_components_are_imported(
    master: Any, tmp_path: Any
) -> None:
    (tmp_path / "domain.pddl").write_text("(define (domain d) (:predicates (p)))")
    master.api.setParam("/test", "/rosplan/domain_path", str(tmp_path / "domain.pddl"))
    node = master.node(TOGETHER)
    node.expect("imports")
    assert master.api.lookupService("/test", "/rosplan_knowledge_base/domain/name")[0] == 1
    node.say("")


def test_a_kind_of_component_that_is_none_is_named_before_anything_is_served(master: Any) -> None:
    master.api.setParam("/test", "/planning_system/components", {"a": "knowledge_base", "b": "nonsense"})
    node = master.node(TOGETHER)
    assert node.ended() == 2
    assert "'nonsense' is not a kind of component; there are " in node.output


def test_a_kind_of_dispatcher_that_does_not_exist_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(planning_system, "run_components", lambda name, make: make(name))
    monkeypatch.setattr(rospy, "get_param", lambda *_: "esterell")
    with pytest.raises(ComponentError, match="~kind is 'esterell', expected 'simple' or 'esterel'"):
        planning_system.run_kind("plan_dispatcher")

# SPDX-License-Identifier: Apache-2.0
"""Panels are found by themselves, and those of applications by their class paths."""

import sys
from types import ModuleType, SimpleNamespace
from typing import Any, List

import pytest
import rospkg

from merlin_monitor import panel_board
from merlin_monitor.listeners.panel import Panel
from merlin_monitor.panel_board import OfferedPanels, PanelBoard, foreign_panel, own_panels, script_of
from merlin_monitor.state.inbox import DirectInbox
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_ros.master.master_link import ERRORS
from merlin_ros.parameters import ParameterError


class Guests(Panel):
    name, title, script = "guests", "Guests", "package://merlin_monitor/web/app.js"


class Later(Guests):
    name = "later"


class Guests2(Guests):
    name = "guests2"


def test_each_panel_has_a_script_of_its_name() -> None:
    found = own_panels()
    names = {panel.name for panel in found}
    assert len(found) == len(names) and {"now", "plan", "queue", "map", "history"} <= names
    for panel in found:
        assert script_of(panel).stem == panel.name


def test_a_new_module_is_a_new_panel(monkeypatch: pytest.MonkeyPatch) -> None:
    module = ModuleType(f"{panel_board.panels.__name__}.guests")
    kind = type("New", (Panel,), {"__module__": module.__name__, "name": "guests"})
    vars(module).update(New=kind, Panel=Panel)
    monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setattr(panel_board.pkgutil, "iter_modules", lambda path: [_info("guests")])
    assert own_panels() == [kind], "and the base class that it imports is none"


def _info(name: str) -> Any:
    return panel_board.pkgutil.ModuleInfo(None, name, False)  # type: ignore[arg-type]


def test_an_application_names_its_panel() -> None:
    assert foreign_panel(f"{__name__}:Guests") is Guests
    assert script_of(Guests).name == "app.js"


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"script": "package://no_such_package/x.js"}, "no package no_such_package"),
        ({"script": "package://merlin_monitor/web/nothing.js"}, "no file"),
        ({"script": "/etc/passwd"}, "is not package://"),
        ({"script": "package://merlin_monitor/package.xml"}, "is not package://"),
        ({"script": ""}, "no file"),
    ],
)
def test_a_script_that_cannot_be_served_is_named(fields: Any, said: str) -> None:
    with pytest.raises(ParameterError, match=said):
        script_of(type("Bad", (Guests,), fields))


@pytest.mark.parametrize(
    ("path", "said"),
    [
        ("nothing.here:Guests", "No module"),
        ("pathlib:Path", "is not a merlin_monitor"),
        ("merlin_monitor.listeners.panel:Panel", "has the name ''"),
    ],
)
def test_a_class_that_is_no_panel_is_named(path: str, said: str) -> None:
    with pytest.raises(ParameterError, match=said):
        foreign_panel(path)


def test_panels_that_are_offered_later_are_added_once(monkeypatch: pytest.MonkeyPatch) -> None:
    offered: Any = None
    said: List[str] = []

    def parameter(name: str) -> Any:
        assert name == "/ann/merlin/panels"
        if offered is None:
            raise ERRORS[0]("there is no such parameter")
        return offered

    monkeypatch.setattr(panel_board, "bounded_master", lambda: SimpleNamespace(getParam=parameter))
    monkeypatch.setattr(panel_board.rospy, "resolve_name", lambda name: f"/ann/{name}")
    monkeypatch.setattr(panel_board.rospy, "logwarn", said.append)
    panels = OfferedPanels([f"{__name__}:Known"])
    assert panels.new(["plan"]) == []
    offered = {"a": f"{__name__}:Guests", "b": "nothing.here:Panel", "c": f"{__name__}:Known", "d": 7}
    assert panels.new(["plan"]) == [Guests]
    assert len(said) == 2 and "No module" in said[0] and "/ann/merlin/panels" in said[0]
    assert panels.new(["plan", "guests"]) == [] and len(said) == 2
    offered = "text"
    assert panels.new(["plan"]) == []
    assert OfferedPanels().new(["plan"]) == []
    offered = {"a": f"{__name__}:Guests"}
    assert OfferedPanels().new(["guests"]) == [] and "two panels called guests" in said[-1]


class Unusable(Guests):
    name = "unusable"

    def __init__(self, *_: Any) -> None:
        raise KeyError("strange")


def test_an_offered_panel_that_cannot_be_made_keeps_no_other_from_its_begin(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    begun: List[str] = []

    def start(panel: Panel) -> None:
        begun.append(panel.name)
        raise ValueError("strange")

    offered = {"a": f"{__name__}:Unusable", "b": f"{__name__}:Guests"}
    master = SimpleNamespace(getParam=lambda name: offered)
    monkeypatch.setattr(panel_board, "bounded_master", lambda: master)
    monkeypatch.setattr(Guests, "start", start)
    ros: Any = SimpleNamespace(parameter=lambda name, default: default, namespace="/", look=lambda: {})
    state = MonitorModel(DirectInbox())
    board = PanelBoard(state, offered=True, ros=ros, only=[])
    assert list(board.scripts) == ["guests"]
    assert [panel["name"] for panel in state.tree.get("meta", "panels")] == ["guests"]
    offered = {"c": f"{__name__}:Later", "d": f"{__name__}:Guests2"}
    board.look()
    assert begun == ["later", "guests2"]
    assert set(board.scripts) == {"guests", "later", "guests2"}


def test_a_package_is_looked_up_as_ros_does() -> None:
    assert script_of(Guests).is_relative_to(rospkg.RosPack().get_path("merlin_monitor"))

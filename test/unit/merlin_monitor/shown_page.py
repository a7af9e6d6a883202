# SPDX-License-Identifier: Apache-2.0
"""The page over a model that is filled by hand: a robot in the middle of a mission, without ROS."""

import threading
from pathlib import Path
from typing import Any, Dict, List

import axe_core_python
import numpy
import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from merlin_msgs.msg import (
    ExecutorStatus,
    GoalQueue,
    GuardStatus,
    ListenResult,
    MissionStatus,
    QueuedGoal,
)
from messages import dispatch, executor, fact, feedback, running, status, structure, value
from nav_msgs.msg import OccupancyGrid
from rosplan_dispatch_msgs.msg import CompletePlan
from sensor_msgs.msg import Image
from served import TOKEN, Served
from sound_play.msg import SoundRequest

from merlin_monitor.panel_board import own_panels, script_of
from merlin_monitor.panels.said import SaidSection
from merlin_monitor.state.knowledge_section import Contents
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_monitor.state.plan_steps import sequential_steps
from merlin_test import LONG
from merlin_test.chromium import Visit, chromium  # noqa: F401  (for the tests)

# To be put in by the browser's own means (bypass_csp), past the policy of the page.
AXE = Path(axe_core_python.__file__).with_name("axe.min.js")
#: What bars people from the page, and each rule of axe that cannot judge it; of all rules, or of some.
CHECK = """async (rules) => {
  const asked = rules ? { runOnly: rules } : {};
  const { violations, incomplete } = await axe.run(document, { resultTypes: ["violations"], ...asked });
  return [
    ...incomplete.filter(({ message }) => message).map(({ id, message }) => `${id}: ${message}`),
    ...violations.map(({ id, nodes }) =>
      `${id}: ${nodes.slice(0, 4).map((node) => `${node.target} ${node.failureSummary}`)}`),
  ];
}"""

#: The rules of axe that judge colours: where nothing else has changed, the others would find the same again.
COLOURS = ["color-contrast", "link-in-text-block"]

NOW = 120.0  # s of ROS time
PLACES = {
    "kitchen": {"x": 1.0, "y": 1.0},
    "bathroom": {"x": 3.0, "y": 1.2},
    "dorm_room": {"x": 3.2, "y": 3.0},
    "main_door": {"x": 0.8, "y": 3.1},
}

DOMAIN: Dict[str, Any] = {
    "name": "home",
    "types": {"poi": "object"},
    "predicates": {"checked": [["p", "poi"]], "robot_at": [["p", "poi"]]},
    "functions": {},
    "operators": {"navigate": [["from", "poi"], ["to", "poi"]], "ask": [["p", "poi"]]},
    "adds": {"navigate": [["robot_at", "to"]], "ask": [["checked", "p"]]},
}


def show_panels(served: Served) -> None:
    """Has the page draw all panels of the monitor."""
    panels = sorted(own_panels(), key=lambda panel: panel.place)
    served.scripts.update({panel.name: script_of(panel) for panel in panels})
    tree = served.state.tree
    served.state.checked_at = float("inf")  # nothing hangs here
    for field, shown in (
        ("robot", ""),
        ("simulated", True),
        ("time", NOW),
        ("control", True),
        ("simulator", {"paused": False, "factor": 2}),
        ("panels", [panel.described() for panel in panels]),
    ):
        tree.set("meta", field, shown)


def plan_message(steps: int) -> CompletePlan:
    """A plan that drives from place to place and asks there."""
    places = list(PLACES)
    actions: List[Any] = []
    for number in range(steps):
        before, place = places[(number // 2 - 1) % 4], places[number // 2 % 4]
        pairs = (("from", before), ("to", place)) if number % 2 == 0 else (("p", place),)
        name = "navigate" if number % 2 == 0 else "ask"
        actions.append(dispatch(number, name, *pairs, duration=10.0, dispatch_time=10.0 * number))
    return CompletePlan(actions)


def fill(served: Served, steps: int = 6) -> None:
    """A mission at its third task; one step of the plan is done, the second runs since 5 s."""
    show_panels(served)
    state = served.state
    mission = MissionStatus(mission="Round", state=1, task=3, tasks=6, description="ask in the kitchen")
    request = "/mission-3-120.5"
    doing = executor(
        ExecutorStatus.RUNNING,
        request=request,
        goals=["(checked kitchen)"],
        running=[running(1, "ask", ("p", "kitchen"))],
        steps_done=1,
        steps_total=steps,
    )
    plan = plan_message(steps)

    def take() -> None:
        state.domain(DOMAIN)
        state.places(set(state.map.points(PLACES)))
        state.now.mission(mission, 100.0, "/mission")
        state.now.executor(doing, 100.0)
        state.planned(*sequential_steps(plan), 100.0)
        state.plan.dispatched(plan.plan[0], 103.0)
        state.plan.feedback(feedback(0, 2), 115.0)
        state.plan.dispatched(plan.plan[1], 115.0)
        state.plan.feedback(feedback(1, 1), 115.0)
        waiting = QueuedGoal(request="/mission-4-1.0", goals=["(checked bathroom)"], queued=rospy.Time(101))
        state.now.queue(GoalQueue(requests=[waiting]), 101.0)
        state.guard.status(GuardStatus(state=GuardStatus.PASSING), 100.0, 0.0)
        _fill_world(state)
        _fill_parts(state)
        _fill_said(state)
        state.now.refresh()
        state.refresh_problems(0.0)

    taken = threading.Event()
    state.inbox.put(take)
    state.inbox.put(taken.set)
    assert taken.wait(LONG)  # what a test changes then is not changed back by this


def signed_in(visit: Visit) -> None:
    """Signs Ana in, and waits until the page shows her name."""
    visit.page.click("#operator")
    visit.page.fill("#token", TOKEN)
    visit.page.keyboard.press("Enter")
    visit.wait_text("#operator", "Ana")


def look_again(served: Served) -> None:
    """What the pulse does: says anew what the robot does and what is wrong."""
    served.state.inbox.put(served.state.now.refresh)
    served.state.inbox.put(served.state.refresh_problems, 1.0)


def _fill_world(state: MonitorModel) -> None:
    grid = OccupancyGrid(data=([100] * 10 + ([100] + [0] * 8 + [100]) * 8 + [100] * 10))
    grid.info.width = grid.info.height = 10
    grid.info.resolution = 0.4
    state.map.grid(grid)
    for step in range(6):
        state.map.robot((0.9 + 0.1 * step, 1.0 + 0.04 * step, 0.5), 110.0)
    state.map.seen(numpy.array([(2.4, 2.0), (2.5, 2.05), (0.1, 1.0)]))
    state.map.path([(1.4, 1.2), (2.0, 1.0), (3.0, 1.2)])
    state.map.goal((3.0, 1.2, 0.0))
    facts = [fact("robot_at", "kitchen"), fact("checked", "main_door"), fact("in_service")]
    objects = dict.fromkeys(PLACES, "poi")
    far = [value("travel_time", "kitchen", "bathroom", number=7.5)]
    state.knowledge.replace(Contents(objects, facts, far, []), "/mission", 100.0, True)


def _fill_said(state: MonitorModel) -> None:
    said = SaidSection(state.tree, state.pictures, state.report)
    said.spoken(SoundRequest(sound=SoundRequest.SAY, arg="Do you need anything?"), 116.0)
    said.heard(ListenResult(text="a coffee please", heard=True), 118.0)
    said.seen(["cup", "cup", "person"], 119.0)
    image = Image(width=64, height=48, encoding="bgr8", step=192, data=bytes(range(192)) * 48)
    said.image(image)


def _fill_parts(state: MonitorModel) -> None:
    levels: Dict[str, int] = {"battery": DiagnosticStatus.WARN, "camera": DiagnosticStatus.ERROR}
    parts = [
        DiagnosticStatus(
            name=f"{name}: state", level=level, message=f"{name} reports", values=[KeyValue("a", "1")]
        )
        for name, level in {
            **levels,
            **{f"node_{number}": DiagnosticStatus.OK for number in range(12)},
        }.items()
    ]
    state.health.diagnostics(DiagnosticArray(status=parts), 100.0, 0.0)
    edges = [("succeeded", "DRIVE", "SAY"), ("succeeded", "SAY", "None"), ("aborted", "DRIVE", "None")]
    for name in ("NAVIGATE", "ASK", "TAKE_ORDER"):
        container = structure(f"/{name}", ["DRIVE", "SAY"], edges, ["succeeded", "aborted"])
        state.machines.structure("/host", container, 0.0)
        active = ["SAY"] if name == "TAKE_ORDER" else []
        state.machines.status("/host", status(f"/{name}", *active, info="INITIAL_STATUS"), 100.0, 0.0)

# SPDX-License-Identifier: Apache-2.0
"""One planner and several clients: who waits for its turn, and what ends the wait."""

import contextlib
import threading
from queue import Queue
from types import SimpleNamespace
from typing import Any, Callable, Dict, Iterator

import pytest
import rospy
from actionlib_msgs.msg import GoalID, GoalStatus
from fakes.topics import Topics
from rosplan_dispatch_msgs.msg import PlanActionGoal, PlanGoal
from rosplan_dispatch_msgs.srv import PlanningServiceRequest

from merlin_rosplan.nodes.planner_interface import PlannerInterface
from merlin_rosplan.planning.planning_outcome import PlannerState, PlanningOutcome
from merlin_rosplan.transport import component
from merlin_test import LONG

ACTION = "/planner/start_planning"
FILES = {"domain_path": "/domain.pddl", "problem_path": "/problem.pddl"}


class Planning:
    """Lasts until a test ends it, or it is cancelled."""

    warning = None

    def __init__(self) -> None:
        self.ended = threading.Event()
        self.state = PlannerState.UNSOLVABLE

    def cancel(self) -> None:
        self.state = PlannerState.CANCELLED
        self.ended.set()

    def run(self, on_begin: Callable[[], None]) -> PlanningOutcome:
        on_begin()
        assert self.ended.wait(LONG)
        return PlanningOutcome(self.state, "test")


class Bench:
    """A planner interface without a master and a planner."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.topics = Topics(monkeypatch)
        self.plannings: Queue[Planning] = Queue()
        self.services: Dict[str, Callable[[Any], Any]] = {}
        for place, name, made in (
            (component, "Service", self._service),
            (component, "offer", lambda *_: None),
            (component, "announced_together", contextlib.nullcontext),
            (component, "keep_params", lambda scope: {}),
            (rospy.Time, "now", lambda: rospy.Time(1)),
            *((rospy, level, lambda *_: None) for level in ("loginfo", "logwarn", "logerr")),
        ):
            monkeypatch.setattr(place, name, made)
        monkeypatch.setattr("merlin_rosplan.supervision.supervised_planning.Planning", self._planning)
        self.planner = PlannerInterface("/planner")

    def _service(self, name: str, _: type, answer: Callable[[Any], Any]) -> Any:
        self.services[name] = answer
        return SimpleNamespace(shutdown=lambda: None)

    def _planning(self, *_: Any) -> Planning:
        made = Planning()
        self.plannings.put(made)
        return made

    def call(self) -> threading.Thread:
        """Another client calls the service."""
        request = PlanningServiceRequest(**FILES)
        call = threading.Thread(
            target=self.services["/planner/planning_server_params"], args=(request,), daemon=True
        )
        call.start()
        return call

    def wait_active(self) -> None:
        """Waits until a goal is being worked on."""
        statuses = self.topics.published(f"{ACTION}/status")
        while not any(each.status == GoalStatus.ACTIVE for each in statuses.get(timeout=LONG).status_list):
            pass

    def result(self) -> GoalStatus:
        """How the goal has ended."""
        return self.topics.published(f"{ACTION}/result").get(timeout=LONG).status


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    made = Bench(monkeypatch)
    yield made
    made.planner.shutdown()


def test_a_goal_that_waits_for_the_planning_of_another_client_is_cancelled_at_once(bench: Bench) -> None:
    other = bench.call()
    first = bench.plannings.get(timeout=LONG)
    goal = PlanActionGoal(goal_id=GoalID(id="goal", stamp=rospy.Time(1)), goal=PlanGoal(**FILES))
    bench.topics.send(f"{ACTION}/goal", goal)
    bench.wait_active()
    bench.topics.send(f"{ACTION}/cancel", GoalID(id="goal"))
    result = bench.result()
    assert (result.status, result.text) == (GoalStatus.PREEMPTED, "cancelled before it began")
    assert other.is_alive() and not first.ended.is_set(), "the other client's planning goes on"
    first.ended.set()
    other.join(LONG)
    again = PlanActionGoal(goal_id=GoalID(id="next", stamp=rospy.Time(2)), goal=PlanGoal(**FILES))
    bench.topics.send(f"{ACTION}/goal", again)
    bench.plannings.get(timeout=LONG).ended.set()
    assert bench.result().status == GoalStatus.ABORTED

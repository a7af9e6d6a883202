# SPDX-License-Identifier: Apache-2.0
"""What is judged of requests that run together."""

from typing import Any, List, Optional

import pytest
from chaos.faults import CANCEL_AHEAD, EXECUTE, NONE, SIGNAL, Fault
from chaos.judging import events
from chaos.judging.events import Event
from chaos.judging.evidence import JOINED, REQUEST, Evidence
from chaos.judging.rules import judge
from chaos.moments import Moment
from chaos.trials import Trial

SECOND, THIRD = JOINED
POINTS = {"kitchen": (5.0, 0.0)}
BY_CLIENT = "cancelled by its client"
NOTHING = Fault("none", NONE)


class Scenario:
    """Three requests, and a fault at 10 s: the first one drives until 16 s, the others speak until 12 s."""

    def __init__(self, fault: Fault = NOTHING, cancel: bool = False, driven_until: float = 16.0) -> None:
        self._trial = Trial("test", fault, Moment.DRIVING, cancel, joined=True)
        self._events = [Event(10.0, events.FAULT, {"fault": fault.name, "targets": []})]
        goals = ["(robot_at kitchen)", "(said f1)", "(said f2)"]
        for number, label in enumerate((REQUEST, *JOINED)):
            deadline = 60.0 if label == SECOND else None
            self.add(5.0, events.SENT, label=label, goals=[goals[number]], deadline=deadline)
        self.add(5.1, events.GOALS, server="move_base", active=["a"], ended={})
        self.add(driven_until, events.GOALS, server="move_base", active=[], ended={"a": 2})
        self.add(9.0, events.GOALS, server="sound_play", active=["s"], ended={})
        self.add(12.0, events.GOALS, server="sound_play", active=[], ended={"s": 3})
        for tick in range(120, 500):
            at = tick / 20
            speed = 0.3 if at < driven_until else 0.0
            self.add(at, events.TRUTH, speed=speed, turn=0.0, x=0.3 * min(at, driven_until), y=0.0)

    def add(self, at: float, kind: str, **data: Any) -> "Scenario":
        self._events.append(Event(at, kind, data))
        return self

    def reported(self, at: float, label: str, outcome: str = "SUCCEEDED", reason: str = "") -> "Scenario":
        return self.add(at, events.ENDED, label=label, outcome=outcome, reason=reason, action="", state=3)

    def look(
        self, at: float, said: Optional[List[str]] = None, goals: Optional[List[str]] = None
    ) -> "Scenario":
        said = ["(said f1)", "(said f2)"] if said is None else said
        return self.add(
            at, events.FACTS, robot_at=["(robot_at anywhere)"], notes=[], goals=goals or [], said=said
        )

    def violations(self) -> List[str]:
        log = sorted(self._events, key=lambda event: event.at)
        log.append(Event(log[-1].at + 0.01, events.CLOSED))
        return list(judge(Evidence(self._trial, log, POINTS, [])).violations)


def test_those_that_end_while_the_base_drives_for_the_first_one_are_not_blamed() -> None:
    scenario = Scenario().reported(12.0, SECOND).reported(12.1, THIRD).reported(16.2, REQUEST)
    assert scenario.add(20.0, events.NEXT).look(20.5).violations() == []


def test_those_that_speak_on_when_the_first_one_is_cancelled_are_not_blamed() -> None:
    scenario = Scenario(cancel=True, driven_until=11.5).add(10.1, events.CANCEL, label=REQUEST)
    scenario.reported(11.6, REQUEST, "CANCELLED", BY_CLIENT).reported(12.1, SECOND).reported(12.2, THIRD)
    assert scenario.violations() == []


def test_a_drive_that_outlives_its_cancelled_request_is_seen() -> None:
    scenario = Scenario(cancel=True).add(10.1, events.CANCEL, label=REQUEST)
    scenario.reported(11.6, REQUEST, "CANCELLED", BY_CLIENT).reported(12.1, SECOND).reported(12.2, THIRD)
    assert any("move_base has not ended its goal" in each for each in scenario.violations())


@pytest.mark.parametrize("label, other", [(REQUEST, THIRD), (THIRD, REQUEST)])
def test_one_that_ends_by_the_cancel_of_another_one_is_seen(label: str, other: str) -> None:
    scenario = Scenario(driven_until=10.5).add(10.1, events.CANCEL, label=SECOND)
    scenario.reported(10.6, SECOND, "CANCELLED", BY_CLIENT).reported(12.5, label, "CANCELLED", BY_CLIENT)
    name = "first" if label == REQUEST else label
    found = scenario.reported(12.6, other).violations()
    assert [each.startswith(f"the {name} request is cancelled") for each in found] == [True]


@pytest.mark.parametrize(
    ("action", "at", "blamed"), [(EXECUTE, 10.5, 0), (EXECUTE, 9.5, 2), ("move_base", 10.5, 3)]
)
def test_a_cancel_with_a_stamp_is_for_each_that_was_sent_before(action: str, at: float, blamed: int) -> None:
    scenario = Scenario(Fault("ahead", CANCEL_AHEAD, on=action), driven_until=10.4)
    for label in (REQUEST, *JOINED):
        scenario.reported(10.6 if label == REQUEST else at, label, "CANCELLED", BY_CLIENT)
    found = [each for each in scenario.violations() if "its client has not done that" in each]
    assert len(found) == blamed


def test_one_that_is_late_without_a_deadline_is_seen() -> None:
    late = "late: its goals do not hold by its deadline 65.0 s"
    scenario = (
        Scenario()
        .reported(12.1, SECOND, "LATE", late)
        .reported(12.2, THIRD, "LATE", late)
        .reported(16.2, REQUEST)
    )
    assert [each.startswith("the third request is late") for each in scenario.violations()] == [True]


def test_one_that_ends_twice_is_seen() -> None:
    scenario = (
        Scenario().reported(12.0, SECOND).reported(12.1, THIRD).reported(12.2, THIRD).reported(16.2, REQUEST)
    )
    assert [each.startswith("the third request has ended 2 times") for each in scenario.violations()] == [
        True
    ]


def test_a_success_whose_goal_does_not_hold_is_seen() -> None:
    scenario = Scenario().reported(12.0, SECOND).reported(12.1, THIRD).reported(16.2, REQUEST)
    scenario.add(20.0, events.NEXT).look(20.5, said=["(said f1)"])
    assert ["(said f2) does not hold" in each for each in scenario.violations()] == [True]


def test_a_goal_that_is_left_is_seen() -> None:
    scenario = Scenario().reported(12.0, SECOND).reported(12.1, THIRD).reported(16.2, REQUEST)
    scenario.add(20.0, events.NEXT).look(20.5).look(26.0, goals=["(said f2)"])
    assert ["goals are left" in each for each in scenario.violations()] == [True]


def test_one_that_hangs_behind_its_cancel_is_seen() -> None:
    scenario = Scenario().reported(12.0, SECOND).reported(16.2, REQUEST).add(17.0, events.CANCEL, label=THIRD)
    assert ["hangs" in each for each in scenario.add(60.0, events.NEXT).violations()] == [True]


def test_the_base_of_a_cancelled_request_may_stop_behind_the_plan_for_the_others() -> None:
    def violations(fault: Fault, until: float) -> List[str]:
        scenario = Scenario(fault, True, until).add(10.1, events.CANCEL, label=REQUEST)
        return scenario.reported(until + 0.1, REQUEST, "CANCELLED", BY_CLIENT).violations()

    assert violations(NOTHING, 12.5) == []
    assert any("stands only" in each for each in violations(NOTHING, 14.5))
    killed = Fault("navigation:kill", SIGNAL, ("navigation",), "KILL")
    assert any("stands only" in each for each in violations(killed, 12.5))

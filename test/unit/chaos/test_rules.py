# SPDX-License-Identifier: Apache-2.0
"""The witness's judgement: each violation that the campaign knows is seen, and a good robot is not blamed."""

from typing import Any, Dict, List, Optional

import pytest
from chaos.faults import NONE, SECOND_NODE, SIGNAL, Fault
from chaos.judging import events
from chaos.judging.events import Event
from chaos.judging.evidence import NEXT, PATIENCE, REQUEST, Evidence
from chaos.judging.rules import Judgement, judge
from chaos.moments import Moment
from chaos.trials import Trial, Variant

POINTS = {"kitchen": (5.0, 0.0), "bathroom": (0.0, 5.0)}
NOTES = ["(noted n1)"]
KILL = Fault("merlin_fsm_host:kill", SIGNAL, ("merlin_fsm_host",), "KILL")
DRIVING = Trial("test", KILL, Moment.DRIVING, cancel=True)


class Scenario:
    """Events of a drive with a fault at 10 s; the base obeys `stop`."""

    def __init__(self) -> None:
        self.events: List[Event] = []
        self.add(5.0, events.SENT, label=REQUEST, goals=["(robot_at kitchen)"])
        self.add(5.1, events.GOALS, server="move_base", active=["a"], ended={})
        self.add(10.0, events.FAULT, fault="x", targets=[])

    def add(self, at: float, kind: str, **data: Any) -> "Scenario":
        self.events.append(Event(at, kind, data))
        return self

    def drive(self, begin: float, end: float, until: float) -> "Scenario":
        """0.3 m/s from begin to end, then standing; the truth comes with 20 Hz."""
        for tick in range(round(begin * 20), round(until * 20) + 1):
            at = tick / 20
            x = 0.3 * (min(at, end) - begin)
            self.add(at, events.TRUTH, speed=0.3 if at < end else 0.0, turn=0.0, x=x, y=0.0)
        return self

    def reported(
        self, at: float, outcome: str = "CANCELLED", reason: str = "cancelled", label: str = REQUEST
    ) -> "Scenario":
        return self.add(at, events.ENDED, label=label, outcome=outcome, reason=reason, action="", state=2)

    def facts(self, at: float, places: Optional[List[str]] = None, **data: Any) -> "Scenario":
        names = ["anywhere"] if places is None else places
        fields: Dict[str, Any] = {
            "robot_at": [f"(robot_at {name})" for name in names],
            "notes": NOTES,
            "goals": [],
        }
        return self.add(at, events.FACTS, **{**fields, **data})

    def next_goal(self, at: float, after: float = 0.5) -> "Scenario":
        self.add(at, events.NEXT)
        self.add(at + 0.1, events.SENT, label=NEXT, goals=["(robot_at bathroom)"])
        self.add(at + after, events.GOALS, server="move_base", active=["b"], ended={"a": 2})
        self.add(at + after + 0.1, events.CANCEL, label=NEXT)
        self.add(at + after + 0.15, events.GOALS, server="move_base", active=[], ended={"a": 2, "b": 2})
        return self.reported(at + after + 0.2, label=NEXT)

    def judge(self, trial: Trial = DRIVING, patience: float = PATIENCE) -> Judgement:
        log = sorted(self.events, key=lambda event: event.at)
        log.append(Event(log[-1].at + 0.01, events.CLOSED))
        return judge(Evidence(trial, log, POINTS, NOTES, patience))


def good() -> Scenario:
    scenario = Scenario().drive(6.0, 10.6, 20.0).add(10.01, events.CANCEL, label=REQUEST)
    scenario.add(10.6, events.GOALS, server="move_base", active=[], ended={"a": 2})
    return scenario.reported(10.8).facts(12.0).next_goal(12.1)


def only(judgement: Judgement, *words: str) -> None:
    assert len(judgement.violations) == 1, judgement.violations
    for word in words:
        assert word in judgement.violations[0]


def test_a_robot_that_stops_tells_and_goes_on_is_not_blamed() -> None:
    judgement = good().judge()
    assert judgement.violations == ()
    assert judgement.stand == pytest.approx(0.6)
    assert judgement.answer == pytest.approx(0.79)
    assert judgement.following == pytest.approx(0.5)
    assert judgement.outcome == "CANCELLED"


@pytest.mark.parametrize(("goal", "blamed"), [("a", True), ("new", False)])
def test_a_base_that_stands_shortly_may_drive_for_a_new_goal_only(goal: str, blamed: bool) -> None:
    scenario = Scenario().drive(6.0, 10.6, 10.7)
    scenario.add(10.72, events.GOALS, server="move_base", active=[goal], ended={})
    for tick in range(215, 400):
        scenario.add(tick / 20, events.TRUTH, speed=0.3, turn=0.0, x=2.0, y=0.0)
    judgement = scenario.judge(Trial("test", KILL, Moment.DRIVING))
    assert any("drives on" in text for text in judgement.violations) == blamed


def test_a_base_that_drives_on_is_seen_with_how_far() -> None:
    scenario = Scenario().drive(6.0, 99.0, 20.0)
    scenario.add(10.5, events.GOALS, server="move_base", active=[], ended={"a": 2})
    judgement = scenario.judge(Trial("test", KILL, Moment.DRIVING))
    assert any("drives on" in text and "3.0 m" in text for text in judgement.violations)
    assert judgement.stand is None


@pytest.mark.parametrize(("signal", "blamed"), [("KILL", True), ("STOP", False)])
def test_a_hung_owner_gives_half_a_second_more(signal: str, blamed: bool) -> None:
    fault = Fault("x", SIGNAL, ("merlin_fsm_host",), signal)
    scenario = (
        Scenario().drive(6.0, 11.3, 20.0).add(11.3, events.GOALS, server="move_base", active=[], ended={})
    )
    judgement = scenario.reported(11.4, "ACTION_FAILED", "fsm host is gone").judge(
        Trial("t", fault, Moment.DRIVING)
    )
    assert bool(judgement.violations) == blamed


def test_a_base_that_a_wall_has_stopped_does_not_stand() -> None:
    scenario = Scenario().drive(6.0, 10.6, 20.0).add(9.9, events.COMMAND, speed=0.3, turn=0.0)
    scenario.add(10.6, events.GOALS, server="move_base", active=[], ended={"a": 2}).reported(
        10.7, "ACTION_FAILED"
    )
    only(scenario.judge(Trial("t", KILL, Moment.DRIVING)), "drives on, or would")
    scenario.add(10.5, events.COMMAND, speed=0.0, turn=0.0)
    assert scenario.judge(Trial("t", KILL, Moment.DRIVING)).violations == ()


@pytest.mark.parametrize(
    "fault",
    [
        Fault("x", SIGNAL, ("soundplay_node",), "KILL"),
        # It is refused, and the first one goes on.
        Fault("second:merlin_bridges", SECOND_NODE, ("merlin_bridges",)),
    ],
)
def test_a_fault_that_takes_no_owner_lets_the_base_drive(fault: Fault) -> None:
    scenario = (
        Scenario().drive(6.0, 15.0, 20.0).add(15.0, events.GOALS, server="move_base", active=[], ended={})
    )
    judgement = scenario.reported(15.1, "SUCCEEDED", "").judge(Trial("t", fault, Moment.DRIVING))
    assert judgement.violations == ()
    assert judgement.stand is None


def starve(scenario: Scenario, begin: float, end: float, share: float) -> Scenario:
    """A machine that lets the system wait for a share of a time."""
    for number in range(round((end - begin) * 4)):
        scenario.add(begin + (number + 1) / 4, events.WAITED, span=0.25, waited=0.25 * share)
    return scenario


def test_what_a_starved_machine_has_taken_is_given_back() -> None:
    def late(stop: float = 11.4) -> Scenario:
        scenario = Scenario().drive(6.0, stop, 20.0).add(10.01, events.CANCEL, label=REQUEST)
        scenario.add(stop, events.GOALS, server="move_base", active=[], ended={"a": 2})
        return scenario.reported(stop + 0.2).facts(stop + 0.6)

    only(late().judge(), "stands only 1.40 s after")
    assert starve(late(), 10.0, 11.0, 0.8).judge().violations == ()
    only(starve(late(), 10.0, 11.0, 0.2).judge(), "stands only")  # as always on a machine that has time
    only(starve(late(), 6.0, 10.0, 1.0).judge(), "stands only")  # before the fault
    only(starve(late(13.0), 10.0, 13.0, 1.0).judge(), "stands only")  # not for ever
    assert starve(late(13.0), 10.0, 13.0, 1.0).judge(patience=4.0).violations == ()


def test_a_starved_machine_does_not_excuse_a_base_that_drives_on() -> None:
    scenario = starve(Scenario().drive(6.0, 99.0, 30.0), 6.0, 30.0, 1.0)
    judgement = scenario.reported(11.0, "ACTION_FAILED").judge(Trial("test", KILL, Moment.DRIVING))
    assert any("drives on" in text for text in judgement.violations)


def test_a_full_disk_is_named() -> None:
    def refused() -> Scenario:
        return good().add(10.5, events.WRITTEN, fact="(noted f1)", error="refused")

    only(refused().judge(), "no node says that the disk of knowledge.sqlite is full; said: nothing")
    only(
        refused().add(10.6, events.SAID, node="/kb", level=8, text="cannot write").judge(),
        "said: 'cannot write'",
    )
    text = "the state file cannot be written: /x/knowledge.sqlite: database or disk is full"
    assert refused().add(10.6, events.SAID, node="/kb", level=8, text=text).judge().violations == ()
    assert good().add(10.5, events.WRITTEN, fact="(noted f1)", error="").judge().violations == ()


def test_cancelled_while_the_base_drives_is_a_lie() -> None:
    scenario = Scenario().drive(6.0, 14.0, 20.0).add(10.0, events.CANCEL, label=REQUEST).reported(10.5)
    scenario.add(14.0, events.GOALS, server="move_base", active=[], ended={"a": 2})
    found = " | ".join(scenario.judge().violations)
    assert "CANCELLED is reported at 0.50 s, and the base moves with 0.30 m/s" in found
    assert "move_base has not ended its goal" in found
    assert "the base moves until 3.95 s" in found or "the base moves until 4.00 s" in found


@pytest.mark.parametrize(("killed", "blamed"), [(True, False), (False, True)])
def test_a_hung_server_that_was_killed_has_no_goal_any_more(killed: bool, blamed: bool) -> None:
    scenario = good().add(8.0, events.GOALS, server="listen", active=["c"], ended={})
    if killed:
        scenario.add(12.05, events.HELPED, what="listen killed")
    trial = Trial("test", Fault("listen:stop", SIGNAL, ("listen",), "STOP"), Moment.LISTENING, cancel=True)
    found = [
        text for text in scenario.judge(trial).violations if text.startswith("CANCELLED is reported at 2.80")
    ]
    assert bool(found) is blamed


@pytest.mark.parametrize(("reported", "blamed"), [(16.0, True), (17.5, False)])
def test_a_hung_server_is_given_up(reported: float, blamed: bool) -> None:
    scenario = Scenario().add(8.0, events.GOALS, server="listen", active=["c"], ended={})
    scenario.add(10.2, events.GOALS, server="move_base", active=[], ended={"a": 3}).drive(
        6.0, 9.0, 20.0
    ).reported(reported)
    trial = Trial("test", Fault("listen:stop", SIGNAL, ("listen",), "STOP"), Moment.LISTENING)
    found = [text for text in scenario.judge(trial).violations if "listen has not ended its goal" in text]
    assert bool(found) is blamed


def test_a_base_may_brake_after_the_end_but_nothing_may_command_it() -> None:
    braking = Scenario().drive(6.0, 10.4, 20.0).add(10.0, events.CANCEL, label=REQUEST)
    braking.add(10.0, events.GOALS, server="move_base", active=[], ended={"a": 2}).reported(10.05)
    assert braking.judge().violations == ()
    braking.add(12.0, events.COMMAND, speed=0.3, turn=0.0)
    only(braking.judge(), "cmd_vel is not zero until 2.00 s")


def test_a_base_that_has_turned_may_brake_and_rock_back() -> None:
    """1 rad/s at 2 rad/s² takes half a second; the physics of the wheels rock a base back with 0.01 m/s."""
    scenario = Scenario().drive(6.0, 10.1, 20.0).add(10.0, events.CANCEL, label=REQUEST)
    scenario.add(10.0, events.GOALS, server="move_base", active=[], ended={"a": 2}).reported(10.02)
    for event in scenario.events:
        if event.kind == events.TRUTH and event.at >= 10.1:
            event.data["turn"] = max(0.0, 1.0 - 2.0 * (event.at - 10.1))
            event.data["speed"] = -0.01 if event.at < 11.0 else 0.0
    assert scenario.judge().violations == ()


def test_a_slow_world_brakes_slowly() -> None:
    """At a fifth of real time a base needs five times as long to brake, and is not blamed for it."""
    scenario = Scenario().drive(6.0, 11.6, 20.0).add(10.0, events.CANCEL, label=REQUEST).reported(10.1)
    scenario.add(10.0, events.GOALS, server="move_base", active=[], ended={"a": 2})
    assert scenario.judge().violations
    scenario.events = [
        Event(event.at, event.kind, {**event.data, "ros": event.at / 5})
        if event.kind == events.TRUTH
        else event
        for event in scenario.events
    ]
    assert scenario.judge().violations == ()


def test_a_dead_server_runs_nothing_any_more() -> None:
    fault = Fault("x", SIGNAL, ("navigation",), "KILL")
    scenario = Scenario().drive(6.0, 10.5, 20.0).add(10.0, events.CANCEL, label=REQUEST).reported(11.0)
    assert scenario.judge(Trial("t", fault, Moment.DRIVING, cancel=True)).violations == ()


def test_an_end_that_comes_late_or_never_is_seen() -> None:
    late = Scenario().drive(6.0, 10.5, 40.0).add(10.0, events.CANCEL, label=REQUEST)
    late.add(10.5, events.GOALS, server="move_base", active=[], ended={"a": 2})
    never = Scenario()
    never.events = list(late.events)
    only(late.reported(21.0).judge(), "only 11.0 s after its cancel")
    only(never.judge(), "it hangs")


def test_a_request_that_does_nothing_hangs() -> None:
    scenario = (
        Scenario()
        .drive(6.0, 10.5, 25.0)
        .add(10.5, events.GOALS, server="move_base", active=[], ended={"a": 2})
    )
    scenario.add(21.0, events.CANCEL, label=REQUEST).reported(21.2)
    only(scenario.judge(Trial("t", KILL, Moment.DRIVING)), "neither ends nor goes on")


def test_a_request_that_goes_on_does_not_hang() -> None:
    scenario = (
        Scenario()
        .drive(6.0, 10.5, 25.0)
        .add(10.5, events.GOALS, server="move_base", active=[], ended={"a": 2})
    )
    scenario.add(18.0, events.DISPATCH, name="navigate", action=0, plan=1)
    scenario.add(21.0, events.CANCEL, label=REQUEST).reported(21.2)
    assert scenario.judge(Trial("t", KILL, Moment.DRIVING)).violations == ()


@pytest.mark.parametrize(
    ("places", "words"),
    [([], "0 robot_at"), (["kitchen", "anywhere"], "2 robot_at"), (["bathroom"], "away from there")],
)
def test_the_place_is_one_and_true(places: List[str], words: str) -> None:
    scenario = good()
    scenario.events = [event for event in scenario.events if event.kind != events.FACTS]
    only(scenario.facts(12.0, places).judge(), words)


def test_lost_facts_left_goals_and_silence_are_seen() -> None:
    only(good().facts(19.0, notes=[]).judge(), "lost", "(noted n1)")
    only(good().facts(19.0, goals=["(robot_at kitchen)"]).judge(), "goals are left")
    only(good().add(19.0, events.FACTS, error="no answer").judge(), "does not answer")


def restarting(settled_at: Optional[float]) -> Scenario:
    """The next goal may be sent at 12 s; until it is settled the knowledge is looked at again."""
    scenario = good()
    scenario.events = [event for event in scenario.events if event.at < 12.0 or event.kind == events.TRUTH]
    scenario.add(12.0, events.NEXT).facts(12.1, []).facts(12.4, [], goals=["(robot_at kitchen)"])
    if settled_at is not None:
        scenario.facts(settled_at)
    sent = 12.5 if settled_at is None else settled_at + 0.1
    scenario.add(sent, events.SENT, label=NEXT, goals=["(robot_at bathroom)"])
    return scenario.add(sent + 4.0, events.GOALS, server="move_base", active=["b"], ended={"a": 2})


def test_what_is_restarted_may_settle_its_knowledge_first() -> None:
    assert restarting(16.0).judge().violations == ()  # and the next goal's time counts from there
    found = " | ".join(restarting(None).judge().violations)
    assert "0 robot_at hold at 2.40 s" in found
    assert "goals are left at 2.40 s" in found
    assert any("0 robot_at hold" in text for text in restarting(18.0).judge().violations)


def test_a_reason_names_a_part() -> None:
    scenario = (
        Scenario().drive(6.0, 10.5, 20.0).add(10.5, events.GOALS, server="move_base", active=[], ended={})
    )
    only(scenario.reported(10.6, "INTERNAL", "[Errno 111] Connection refused").judge(), "names no part")


def test_a_timeout_names_what_did_not_stop() -> None:
    scenario = Scenario().drive(6.0, 10.5, 20.0).add(10.0, events.CANCEL, label=REQUEST)
    only(scenario.reported(15.0, "CANCEL_TIMEOUT", "").judge(), "does not name")


def test_the_next_goal_has_to_begin_in_time() -> None:
    scenario = good()
    scenario.events = [event for event in scenario.events if event.at < 12.1 or event.kind == events.TRUTH]
    late = Scenario()
    late.events = list(scenario.events)
    refused = Scenario()
    refused.events = list(scenario.events)
    only(late.next_goal(12.1, 6.0).judge(), "began only after 6.0 s")
    refused.add(12.1, events.NEXT).add(12.2, events.SENT, label=NEXT, goals=[])
    only(
        refused.reported(12.4, "UNSOLVABLE", "no plan", NEXT).judge(),
        "ended UNSOLVABLE before any action: no plan",
    )
    scenario.add(12.1, events.NEXT).add(12.2, events.SENT, label=NEXT, goals=[])
    only(scenario.judge(), "has not begun")


def test_help_gives_the_next_goal_more_time() -> None:
    scenario = good()
    scenario.events = [event for event in scenario.events if event.at < 12.1 or event.kind == events.TRUTH]
    assert scenario.add(12.0, events.HELPED, what="x").next_goal(12.1, 7.0).judge().violations == ()


@pytest.mark.parametrize(("idle_at", "words"), [(11.0, ""), (22.0, "runs for 12.0 s"), (None, "still runs")])
def test_a_dead_clients_request_is_cancelled(idle_at: Optional[float], words: str) -> None:
    fault = Fault("client:kill", SIGNAL, ("client",), "KILL")
    scenario = (
        Scenario().drive(6.0, 10.5, 25.0).add(10.5, events.GOALS, server="move_base", active=[], ended={})
    )
    scenario.add(10.1, events.STATUS, state=1, stage="x")
    if idle_at is not None:
        scenario.add(idle_at, events.STATUS, state=0, stage="")
    judgement = scenario.judge(Trial("t", fault, Moment.DRIVING))
    if words:
        only(judgement, words)
    else:
        assert judgement.violations == ()


def test_a_request_that_ended_before_its_client_died_outlives_nothing() -> None:
    fault = Fault("client:kill", SIGNAL, ("client",), "KILL")
    scenario = good().add(9.9, events.STATUS, state=0, stage="")
    assert scenario.judge(Trial("t", fault, Moment.CANCELLING)).violations == ()


def test_a_planner_does_not_delay_a_cancel() -> None:
    def scenario(at: float) -> Judgement:
        reported = Scenario().add(9.0, events.GOALS, server="move_base", active=[], ended={"a": 3})
        reported.add(10.0, events.CANCEL, label=REQUEST).reported(at)
        return reported.judge(
            Trial("t", Fault("none", NONE), Moment.PLANNING, True, variant=Variant(planner="slow"))
        )

    assert scenario(11.5).violations == ()
    only(scenario(13.7), "only 3.7 s after its cancel")


def test_processes_left_behind_are_seen() -> None:
    trial = Trial("t", Fault("none", NONE), Moment.PLANNING, cancel=True)
    only(good().add(18.0, events.LEFT, count=2).judge(trial), "2 processes of the planner")

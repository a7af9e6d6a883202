# SPDX-License-Identifier: Apache-2.0
"""Why a fact is as it is: which action, sensor or client, at which version; the proof of a derived fact."""

import itertools
from pathlib import Path
from typing import List, Set, Tuple

import pytest
from diagnostic_msgs.msg import KeyValue
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from merlin_msgs.msg import KnowledgeChanges
from robot_scenario import BEGIN, BRIDGES, DOMAIN, RobotScenario
from rosplan_knowledge_msgs.msg import KnowledgeItem

from merlin_explain.claims import Answer, QuestionError, Words
from merlin_explain.execution import recorded_past
from merlin_explain.execution.moment import Moment, key_of
from merlin_explain.execution.proof import proof
from merlin_explain.execution.provenance import provenance
from merlin_pddl.domain_reader import parse_domain
from merlin_pddl.formula import Atom, to_pddl
from merlin_pddl.text_reader import PddlError
from merlin_ros.work.passed_time import clock_text

DRIVE = "(drive d1 hall kitchen)"


def ask(scenario: RobotScenario, about: str, seconds: float = 0.0) -> Answer:
    past = scenario.past(seconds)
    try:
        return provenance(past.moment(), past, about, Words(), {BRIDGES})
    finally:
        past.close()


def kinds(answer: Answer) -> List[str]:
    return [claim.kind for claim in answer.claims]


def drive(scenario: RobotScenario) -> None:
    scenario.runs("/mission-1-5.0", ["(tidy kitchen)"])
    scenario.plans((DRIVE, 0.0, 10.0))
    scenario.begins(0)
    scenario.changes(BRIDGES, remove=["(at hall)"])
    scenario.wait(10.0)
    scenario.changes(BRIDGES, add=["(at kitchen)"], battery=19.0)
    scenario.succeeds(0)
    scenario.wait(30.0)


def test_an_action_made_it_so(scenario: RobotScenario) -> None:
    drive(scenario)
    answer = ask(scenario, "(at kitchen)")
    assert kinds(answer) == ["action"]
    assert (
        f"became so at {clock_text(BEGIN + 10)}, version 3 of the knowledge, by “{DRIVE}”" in answer.sentence
    )
    fact, step = answer.claims[0].evidence
    assert (fact.version, step.step) == (3, 1)
    assert "by “(drive d1 hall kitchen)”" in ask(scenario, "(battery)").sentence


def test_the_next_plan_may_come_at_once(scenario: RobotScenario) -> None:
    scenario.plans((DRIVE, 0.0, 10.0))
    scenario.begins(0)
    scenario.now += 0.05
    scenario.changes(BRIDGES, remove=["(at hall)"])
    scenario.now += 10.0
    scenario.changes(BRIDGES, add=["(at kitchen)"])
    scenario.now += 0.05
    scenario.succeeds(0)
    scenario.plans(("(mop kitchen)", 0.0, 4.0))
    scenario.begins(0)
    scenario.wait(20.0)
    assert kinds(ask(scenario, "(at kitchen)")) == kinds(ask(scenario, "(at hall)")) == ["action"]


@pytest.mark.parametrize("order", itertools.permutations(["knowledge", "dispatch", "status"]))
def test_an_action_that_begins_and_ends_while_the_monitor_hangs(
    scenario: RobotScenario, order: Tuple[str, ...]
) -> None:
    scenario.plans(("(mop kitchen)", 0.0, 4.0))
    scenario.wait(1.0)
    began = scenario.now
    scenario.now += 5.0
    for topic in order:
        if topic == "knowledge":
            scenario.changes(BRIDGES, add=["(tidy kitchen)", "(wet kitchen)"], at=began + 0.1)
        elif topic == "status":
            scenario.dispatches(began + 0.01, (0, began))
            scenario.dispatches(began + 0.2)
        else:  # dispatch and feedback have no stamp: their time is when they are heard
            scenario.begins(0)
            scenario.succeeds(0)
    scenario.wait(5.0)
    assert kinds(ask(scenario, "(tidy kitchen)")) == ["action"]


def test_an_action_made_it_untrue(scenario: RobotScenario) -> None:
    drive(scenario)
    answer = ask(scenario, "(at hall)")
    assert kinds(answer) == ["action"]
    assert "does not hold" in answer.sentence and f"ceased to be so at {clock_text(BEGIN)}" in answer.sentence
    assert ask(scenario, "(not (at hall))").claims == answer.claims


def test_another_client_did_it_while_an_action_ran_that_would_have(scenario: RobotScenario) -> None:
    scenario.plans((DRIVE, 0.0, 10.0))
    scenario.begins(0)
    scenario.changes("/localization", add=["(at kitchen)"])
    answer = ask(scenario, "(at kitchen)")
    assert kinds(answer) == ["client"]
    assert "by /localization" in answer.sentence


def test_a_fact_of_before_the_recording(scenario: RobotScenario) -> None:
    assert "since before the recording began" in ask(scenario, "(open d1)").sentence
    assert "nothing has made it true" in ask(scenario, "(open d2)").sentence


def test_a_change_of_long_ago_is_found(scenario: RobotScenario) -> None:
    scenario.changes("/door_sensor", remove=["(open d1)"])
    for number in range(200):
        scenario.now += 10.0
        scenario.changes("/battery", battery=float(number))
    answer = ask(scenario, "(open d1)")
    assert (
        f"ceased to be so at {clock_text(BEGIN)}, version 2 of the knowledge, by /door_sensor"
        in answer.sentence
    )


def test_what_vanished_among_many_changes_is_not_said_to_have_never_been(scenario: RobotScenario) -> None:
    scenario.wait(10.0)
    door, battery = KnowledgeItem(attribute_name="open"), KnowledgeItem(attribute_name="battery")
    door.knowledge_type, battery.knowledge_type = KnowledgeItem.FACT, KnowledgeItem.FUNCTION
    door.values = [KeyValue("", "d1")]
    for number in range(70):  # in one frame, of whose changes the last 60 are noted
        battery.function_value = float(number)
        message = KnowledgeChanges(version=number + 2, client="/many", removed=[door], changed=[battery])
        scenario.model.knowledge.changed(message, scenario.now)
    scenario.wait(0.2)
    scenario.wait(10.0)
    assert ask(scenario, "(open d1)").sentence == (
        f"“(open d1)” does not hold: it ceased to be so at {clock_text(BEGIN + 10.2)}, "
        "by a client that is not known."
    )


def test_what_vanished_with_all_there_was_is_not_said_to_have_never_been(scenario: RobotScenario) -> None:
    scenario.changes("/door_sensor", add=["(open d2)"])
    scenario.wait(10.0)
    scenario.now += 20.0
    scenario.changes("/loader", cleared=True)
    for number in range(400):  # also in segments in which it does not stand
        scenario.now += 1.0
        scenario.changes("/battery", battery=float(number))
    for fact in ("(open d1)", "(open d2)"):
        (claim,) = ask(scenario, fact).claims
        assert claim.kind == "client" and claim.text == (
            f"“{fact}” ceased to be so between {clock_text(BEGIN + 10.0)} and {clock_text(BEGIN + 30.0)}, "
            "by a client that is not known"
        )
    assert "by /battery" in ask(scenario, "(battery)").sentence


def test_what_vanished_while_the_monitor_was_away_is_not_said_to_have_never_been(tmp_path: Path) -> None:
    first = RobotScenario(tmp_path, session="one")
    first.changes("/door_sensor", add=["(open d2)"])
    first.close()
    second = RobotScenario(tmp_path, 20.0, session="one")
    answer = ask(second, "(open d2)")
    assert (
        f"ceased to be so between {clock_text(BEGIN)} and {clock_text(BEGIN + 20.0)}, by a client that is not"
        in answer.sentence
    )
    second.close()


def test_what_was_so_in_an_earlier_life_of_the_monitor_is_as_old_as_it_was_then(tmp_path: Path) -> None:
    first = RobotScenario(tmp_path, session="one")
    first.changes("/door_sensor", remove=["(open d1)", "(at hall)"])
    first.changes("/ana", add=["(open d1)"])
    first.close()
    second = RobotScenario(tmp_path, 20.0, session="one")
    begin, end = clock_text(BEGIN), clock_text(BEGIN + 20.0)
    for fact, said in (
        ("(open d1)", f"it became so at {begin}, version 3 of the knowledge, by /ana."),
        ("(at hall)", f"it became so between {begin} and {end}, by a client that is not known."),
        ("(joins d1 hall kitchen)", "it has been so since before the recording began."),
    ):
        assert ask(second, fact).sentence == f"“{fact}” holds: {said}"
    second.close()


def test_of_a_search_that_takes_too_long_it_is_not_claimed_that_there_was_nothing(
    scenario: RobotScenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recorded_past, "LOOK_BACK", 0.0)
    assert ask(scenario, "(open d2)").sentence == (
        "“(open d2)” does not hold: whether it was true before is not known, as the recording is long."
    )


def test_the_proof_of_a_derived_fact(scenario: RobotScenario) -> None:
    scenario.changes("/door_sensor", add=["(open d2)"])
    answer = ask(scenario, "(way hall attic)")
    assert kinds(answer)[0] == "derived"
    shown = {each.text for each in answer.claims[0].evidence}
    assert shown == {"(joins d1 hall kitchen)", "(open d1)", "(joins d2 kitchen attic)", "(open d2)"}
    assert any("by /door_sensor" in claim.text for claim in answer.claims)


def test_why_a_derived_fact_does_not_hold(scenario: RobotScenario) -> None:
    answer = ask(scenario, "(near kitchen attic)")
    assert answer.sentence.startswith("“(near kitchen attic)” does not hold")
    assert all(claim.evidence for claim in answer.claims)


def test_of_a_past_moment(scenario: RobotScenario) -> None:
    drive(scenario)
    assert "“(at hall)” does not hold" in ask(scenario, "(at hall)", seconds=20.0).sentence
    assert "“(at kitchen)” does not hold" in ask(scenario, "(at kitchen)", seconds=5.0).sentence


@pytest.mark.parametrize(
    "about, words",
    [
        ("(att kitchen)", "att"),
        ("(at moon)", "moon"),
        ("(at)", "at"),
        ("", "say which fact"),
        ("kitchen", "is not PDDL"),
        ("(at (", "is not PDDL"),
    ],
)
def test_what_cannot_be_asked_is_refused(scenario: RobotScenario, about: str, words: str) -> None:
    with pytest.raises((ValueError, PddlError), match=words):
        ask(scenario, about)


Door = Tuple[str, str, bool]
rooms = ("hall", "kitchen", "attic", "yard")
doors = st.lists(st.tuples(st.sampled_from(rooms), st.sampled_from(rooms), st.booleans()), max_size=7)


def moment_of(found: List[Door]) -> Moment:
    facts = {f"(joins d{number} {a} {b})": {} for number, (a, b, _) in enumerate(found)}
    facts.update({f"(open d{number})": {} for number, (_, _, is_open) in enumerate(found) if is_open})
    objects = {
        **{room: {"type": "room"} for room in rooms},
        **{f"d{n}": {"type": "door"} for n in range(len(found))},
    }
    return Moment({"knowledge": {"facts": facts, "objects": objects}}, parse_domain(DOMAIN))


def reached(found: List[Door]) -> Set[Tuple[str, str]]:
    """The pairs of rooms with a way, by the closure."""
    pairs = {(a, b) for a, b, is_open in found if is_open}
    for middle, a, b in itertools.product(rooms, repeat=3):
        if (a, middle) in pairs and (middle, b) in pairs:
            pairs.add((a, b))
    return pairs


@given(doors, st.sampled_from(rooms), st.sampled_from(rooms))
@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_a_proof_is_enough_by_itself_and_there_is_one_for_each_true_fact(
    found: List[Door], a: str, b: str
) -> None:
    moment, asked = moment_of(found), Atom("way", (a, b))
    shown = proof(moment, asked)
    assert (shown is not None) == ((a, b) in reached(found))
    if shown is not None:
        assert all(moment.true(part) for part in shown)
        alone = {
            "facts": {to_pddl(part): {} for part in shown},
            "objects": moment.section("knowledge")["objects"],
        }
        assert Moment({"knowledge": alone}, moment.domain).true(asked)
        assert all(key_of(to_pddl(part))[0] in ("joins", "open") for part in shown)


def test_the_history_of_another_program_is_refused(tmp_path: Path) -> None:
    from merlin_explain.execution.recorded_past import RecordedPast
    from merlin_monitor.history.history_file import HistoryError

    (tmp_path / "history.sqlite").write_text("no history")
    for path in (tmp_path, tmp_path / "other"):
        with pytest.raises(HistoryError, match="history"):
            RecordedPast(path, parse_domain(DOMAIN))


def test_a_condition_that_names_no_fact_is_refused(scenario: RobotScenario) -> None:
    with pytest.raises(QuestionError, match=r"^\(and\) names no fact$"):
        ask(scenario, "(and)")


def test_a_condition_of_which_nothing_more_is_known_is_named_once(scenario: RobotScenario) -> None:
    answer = ask(scenario, "(forall (?r - room) (tidy ?r))")
    assert answer.sentence.count("does not hold") == 1 and answer.sentence.endswith("does not hold.")

# SPDX-License-Identifier: Apache-2.0
"""What actions, goals and reasons are called, with the sentences of an application and without them."""

from pathlib import Path
from typing import Any, Dict, List, Tuple

import pytest
from actionlib_msgs.msg import GoalID, GoalStatus
from merlin_msgs.msg import (
    DispatchStatus,
    ExecuteActionResult,
    ExecuteResult,
    ExecutorStatus,
    MissionStatus,
    PlannerStatus,
)
from messages import Reported, dispatch, executor, feedback, running
from rosplan_dispatch_msgs.msg import CompletePlan

from merlin_monitor.panels.robots import RobotsSection
from merlin_monitor.state.inbox import Inbox
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_monitor.state.plan_steps import sequential_steps
from merlin_monitor.terminal.terminal_view import lines
from merlin_monitor.text.phrase import Phrase, in_english
from merlin_monitor.text.sentences import Sentences, read_sentences
from merlin_monitor.text.wording import Wording

TEXT = """
optional: [r]
operators:
  greet: {en: "[{r} ]greets {C}", de: "[{r} ]begrüßt {c}"}
  wave: {en: waves, de: winkt}
  lead: {en: "{r} leads {c}", de: "{r} führt {c}"}
predicates:
  already_served: {en: "{t} is served", de: "{t} ist bedient", goal: {en: "serve {t}", de: "{t} bedienen"}}
  at: {en: "[{r} is ]at {p}", de: "[{r} ist ]bei {p}"}
objects:
  client_2: {en: guest 2, de: Gast 2}
  table_4: {en: table 4, de: Tisch 4}
"""
ONE: Dict[str, Any] = {
    "types": {},
    "predicates": {"already_served": [["t", "table"]], "at": [["p", "place"]]},
    "operators": {"greet": [["c", "client"]], "wave": [], "check_table": [["t", "table"]]},
}
SEVERAL: Dict[str, Any] = {
    "types": {"waiter": "robot", "robot": ""},
    "predicates": {"already_served": [["t", "table"]], "at": [["r", "robot"], ["p", "place"]]},
    "operators": {
        "greet": [["r", "waiter"], ["c", "client"]],
        "wave": [["r", "waiter"]],
        "lead": [["r", "robot"], ["c", "client"]],
        "check_table": [["r", "robot"], ["t", "table"]],
    },
}


@pytest.fixture
def sentences(tmp_path: Path) -> Sentences:
    path = tmp_path / "sentences.yaml"
    path.write_text(TEXT, encoding="utf-8")
    return read_sentences(path)


def wording(sentences: Sentences, domain: Dict[str, Any]) -> Wording:
    found = Wording(sentences)
    found.learn(domain)
    return found


def both(phrase: Phrase) -> Tuple[str, str]:
    assert isinstance(phrase, dict)
    return str(phrase["english"]), str(phrase["de"])


def test_one_robot_is_not_named(sentences: Sentences) -> None:
    words = wording(sentences, ONE)
    assert both(words.action("greet", [("c", "client_2")])) == ("greets guest 2", "begrüßt Gast 2")
    assert both(words.action("wave", [])) == ("waves", "winkt")
    assert both(words.fact("(at table_4)")) == ("at table 4", "bei Tisch 4")


def test_of_several_each_is_named_in_front_or_where_the_template_has_it(sentences: Sentences) -> None:
    words = wording(sentences, SEVERAL)
    greets = [("r", "robot_2"), ("c", "client_2")]
    assert both(words.action("greet", greets)) == ("robot 2 greets guest 2", "robot 2 begrüßt Gast 2")
    assert both(words.action("wave", greets[:1])) == ("robot 2 waves", "robot 2 winkt")
    assert both(words.fact("(at robot_2 table_4)")) == ("robot 2 is at table 4", "robot 2 ist bei Tisch 4")
    # Beside its name the robot is not named again, but where the template needs it.
    assert both(words.action("greet", greets, subject=False)) == ("greets guest 2", "begrüßt Gast 2")
    assert both(words.action("wave", greets[:1], subject=False)) == ("waves", "winkt")
    assert both(words.action("lead", greets, subject=False))[0] == "robot 2 leads guest 2"


def test_without_a_sentence_the_words_are_those_of_the_names(sentences: Sentences) -> None:
    words = wording(sentences, SEVERAL)
    checks = [("r", "robot_2"), ("t", "table_4")]
    assert in_english(words.action("check_table", checks)) == "robot 2: checking table table 4"
    assert in_english(words.action("check_table", checks, subject=False)) == "checking table table 4"
    assert in_english(words.fact("(dirty table_4)")) == "table 4 dirty"
    unknown = Wording(sentences)  # before the domain is known
    assert in_english(unknown.goal("(already_served table_4)")) == "table 4 served"
    assert in_english(unknown.fact("(already_served table_4)")) == "table 4 already served"


@pytest.mark.parametrize("text", ["((at home) cup)", "(() x)", "(not ((a) b))"])
def test_what_is_no_pddl_has_words_all_the_same(sentences: Sentences, text: str) -> None:
    words = wording(sentences, ONE)
    for said in (words.goal(text), words.fact(text)):
        assert in_english(said).split() or text == "(() x)"


def test_a_goal_is_reported_as_something_wanted(sentences: Sentences) -> None:
    words = wording(sentences, ONE)
    assert both(words.goal("(already_served table_4)")) == ("serve table 4", "Tisch 4 bedienen")
    assert both(words.fact("(already_served table_4)")) == ("table 4 is served", "Tisch 4 ist bedient")


REASONS = [
    ("(check_table r1 t) failed: the door is shut", "the door is shut"),
    ("(check_table r1 t) did not end within 60 s", "did not end within 60 s"),
    (
        "(greet robot_2 client_2) cannot start: (at robot_2 table_4) is false (2 times)",
        "“robot 2 greets guest 2” cannot start: “robot 2 is at table 4” is false (2 times)",
    ),
    ("{0} (fly moon) (greet)", "{0} (fly moon) (greet)"),
]


@pytest.mark.parametrize(("reason", "said"), REASONS)
def test_a_reason_has_no_pddl_of_the_domain(sentences: Sentences, reason: str, said: str) -> None:
    assert in_english(wording(sentences, SEVERAL).reason(reason, "(check_table r1 t)")) == said


def model(sentences: Sentences) -> MonitorModel:
    state = MonitorModel(Inbox())
    state.wording.sentences = sentences
    return state


def test_what_was_heard_before_the_domain_is_reported_anew_with_it(sentences: Sentences) -> None:
    state = model(sentences)
    greet = (("r", "robot_2"), ("c", "client_2"))
    state.planned(*sequential_steps(CompletePlan([dispatch(0, "greet", *greet)])), 0.0)
    request = {"request": "/m-1-1.0", "goals": ["(already_served table_4)"]}
    status = executor(ExecutorStatus.RUNNING, running=[running(0, "greet", *greet)], **request)
    state.now.executor(status, 1.0)
    robots = RobotsSection(state.tree, Reported(), state.wording)
    state.domain(SEVERAL)
    now = state.tree.get("now")
    assert now["doing"] == "robot 2 greets guest 2"
    assert now["because"] == "for “serve table 4”, asked for by /m"
    assert both(state.tree.get("plan", "steps", "0", "words"))[1] == "robot 2 begrüßt Gast 2"
    assert both(state.tree.get("plan", "steps", "0", "does"))[1] == "begrüßt Gast 2"
    assert state.tree.get("knowledge", "words", "facts", "at") == {
        "english": "{0} is at {1}",
        "de": "{0} ist bei {1}",
    }
    robots.dispatcher(DispatchStatus(), 2.0)
    shown = [line.text for line in lines(state.tree.snapshot()[1])]
    assert "  o robot 2 greets guest 2  waiting" in shown


def test_the_monitor_says_once_which_sentences_do_not_fit(sentences: Sentences) -> None:
    state = model(sentences)
    warned: List[str] = []
    for _ in range(2):
        state.domain({**ONE, "operators": {}}, warned.append)
    (warning,) = warned
    assert "the domain has no operator 'greet'" in warning
    assert "(and 2 more; rosrun merlin check names them); such words are made of the names" in warning


@pytest.mark.parametrize(
    ("outcome", "reason", "said"),
    [
        (5, "kairos: relaxed plan graph is empty", ""),
        (8, "(greet client_2) failed: shy; no plan without it: kairos: relaxed plan graph is empty", None),
    ],
)
def test_what_the_planner_prints_is_not_in_the_headline(
    sentences: Sentences, outcome: int, reason: str, said: Any
) -> None:
    state = model(sentences)
    state.domain(ONE)
    request = {"request": "/m-1-1.0", "goals": ["(already_served table_4)"]}
    state.now.executor(executor(ExecutorStatus.RUNNING, **request), 1.0)
    words = "kairos: relaxed plan graph is empty"
    state.plan.planner(PlannerStatus(state=3, planner="kairos", reason=words), 1.5)
    result = ExecuteActionResult(result=ExecuteResult(outcome=outcome, reason=reason))
    result.status = GoalStatus(goal_id=GoalID(id=request["request"]))
    state.now.result(result, 2.0)
    wanted = "“greets guest 2” failed: shy; no plan without it" if said is None else said
    assert in_english(state.tree.get("now", "last", "said")) == wanted
    assert state.tree.get("now", "last", "reason") == reason, "the detail has it"
    state.now.executor(executor(ExecutorStatus.IDLE), 3.0)
    state.now.mission(MissionStatus(mission="Evening", state=MissionStatus.RUNNING), 3.5)
    ends = f"(already_served table_4): UNSOLVABLE: {words}"
    state.now.mission(MissionStatus(mission="Evening", state=4, description=ends), 4.0)
    assert state.tree.get("now", "doing").startswith("Evening has failed: “table 4 is served”: UNSOLVABLE")
    assert words not in state.tree.get("now", "doing")


def test_the_reason_of_a_step_does_not_name_it_again(sentences: Sentences) -> None:
    state = model(sentences)
    state.domain(ONE)
    reported = Reported()
    state.on_event = reported
    state.planned(*sequential_steps(CompletePlan([dispatch(0, "greet", ("c", "client_2"))])), 0.0)
    state.plan.dispatched(dispatch(0, "greet", ("c", "client_2")), 1.0)
    state.plan.feedback(feedback(0, 10, "(greet client_2) did not end within 60 s"), 2.0)
    assert reported.texts[-1] == "greets guest 2: failed after 1.0 s: did not end within 60 s"

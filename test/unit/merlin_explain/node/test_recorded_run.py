# SPDX-License-Identifier: Apache-2.0
"""A run that has ended is asked, from its history and from its bag, without a robot and without a master."""

import errno
import json
import math
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Callable, Dict, Sequence

import genpy
import pytest
import rosbag
import yaml
from diagnostic_msgs.msg import KeyValue
from merlin_msgs.msg import ExecuteActionResult, ExecuteResult, ExecutorStatus, KnowledgeChanges, QueuedGoal
from merlin_msgs.srv import ExplainRequest
from robot_scenario import BEGIN, BRIDGES, DOMAIN, RobotScenario
from rosplan_knowledge_msgs.msg import KnowledgeItem
from std_msgs.msg import String

from merlin_explain.claims import QuestionError
from merlin_explain.node.recorded_run import ask_recording
from merlin_explain.node.why_panel import WhyPanel
from merlin_monitor.bag import BAG, KNOWLEDGE, PARAMETERS
from merlin_rosplan.planning import planner_engines
from merlin_test import LONG
from merlin_test.node_path import node_path

GOAL = "(tidy kitchen)"
DRIVE = "(drive d1 hall kitchen)"
SENTENCES = "predicates: {tidy: {en: 'the {r} is tidy'}}"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """With the history of a run in which the mop does its work, and a request fails later."""
    scenario = RobotScenario(tmp_path)
    tell = scenario.model.tree.set
    parameters = {
        "rosplan_knowledge_base/domain_path": {"text": DOMAIN + "\n; longer than what a page shows" * 500},
        "merlin/sentences": {"text": SENTENCES},
    }
    robot = SimpleNamespace(resolve=str, parameter=parameters.get)
    WhyPanel(scenario.model, robot).look({})  # type: ignore[arg-type]
    tell("why", "interfaces", [BRIDGES])
    scenario.runs("/m-1", [GOAL])
    scenario.plans(("(mop kitchen)", 0.0, 4.0))
    scenario.begins(0)
    scenario.wait(4.0)
    scenario.changes(BRIDGES, add=[GOAL])
    scenario.succeeds(0)
    scenario.wait(60.0)
    scenario.plans((DRIVE, 0.0, 10.0))
    scenario.begins(0)
    scenario.fails(0, "/move_base aborted: no way")
    scenario.dispatch_ended(DRIVE, f"{DRIVE} failed: /move_base aborted: no way")
    scenario.ends("/m-1", ExecuteResult.ACTION_FAILED, f"{DRIVE} failed: /move_base aborted: no way")
    scenario.runs()
    scenario.model.settle()
    scenario.close()
    return tmp_path


def ask(folder: Path, question: str, about: str = "", seconds: float = 0.0, **options: Any) -> Any:
    at = genpy.Time.from_sec(BEGIN + seconds)
    fields = {name: options.pop(name) for name in ("facts", "goals", "include", "without") if name in options}
    request = ExplainRequest(question=question, about=about, **fields)
    return ask_recording(folder, request, (lambda end: at) if seconds else None, **options)


def why(
    *words: str, command: Sequence[str] = (node_path("merlin", "why"),)
) -> "subprocess.CompletedProcess[str]":
    environment = {**os.environ, "ROS_MASTER_URI": "http://127.0.0.1:1"}
    return subprocess.run(
        [*command, *words], env=environment, capture_output=True, text=True, timeout=LONG, check=False
    )


def test_what_failed_and_why_a_fact_was_so(folder: Path) -> None:
    failed = ask(folder, "failed")
    assert failed.ok and "/move_base aborted: “no way”" in failed.sentence
    so = ask(folder, "so", GOAL)
    assert "the kitchen is tidy" in so.sentence and "by “mopping kitchen”" in so.sentence
    assert [claim.kind for claim in so.claims] == ["action"]


def test_a_moment_of_the_run(folder: Path) -> None:
    assert "does not hold" in ask(folder, "so", GOAL, 2.0).sentence
    assert "kitchen tidy" in ask(folder, "doing", "", 2.0).sentence
    with pytest.raises(QuestionError, match=r"the recording is of [\d:]+ to [\d:]+, and has no [\d:]+$"):
        ask(folder, "doing", "", 5000.0)
    with pytest.raises(QuestionError, match=r"and has no \d{4}-\d\d-\d\d [\d:]+$"):
        ask(folder, "doing", "", 500_000.0)
    compound = "(forall (?r - room) (tidy ?r))"  # has no words that could be read
    assert ask(folder, "so", compound).sentence == f"“{compound}” does not hold."


def test_the_command_needs_no_robot(folder: Path) -> None:
    reported = why("--so", GOAL, "--recording", str(folder), "--at", "30s", "--evidence")
    assert reported.returncode == 0, reported.stderr
    assert "the kitchen is tidy" in reported.stdout and "step: (mop kitchen)" in reported.stdout
    assert "does not hold" in why("--so", GOAL, "--recording", str(folder), "--at", "63s").stdout


#: Questions about the folder that have no answer → what is said.
REFUSED = {
    ("--failed", "--recording", "nowhere"): "there is no history",
    ("(mop kitchen)", "--at", "62s"): "the recorded plan does not fit the facts",
    ("--failed", "--run", "7"): "there is no run 7; there are: 1",
    ("--failed", "--domain", "nowhere.pddl"): "nowhere.pddl",
    ("--failed", "--at", "2h"): "the recording is of",
    ("--so", "(dirty kitchen)"): "dirty",
}
#: All of them to one process: one of its own takes a second to begin.
REFUSE = """
import json, sys
from merlin.why.command import main
from merlin_test import LONG
for words in json.loads(sys.argv.pop()):
    sys.argv[1:] = words
    print("exit code", main(), file=sys.stderr, flush=True)
"""


def test_what_cannot_be_answered_says_why(folder: Path) -> None:
    questions = [["--recording", str(folder), *words] for words in REFUSED]
    questions.append(["--failed", "--run", "7"])
    done = why(json.dumps(questions), command=[sys.executable, "-c", REFUSE])
    assert done.returncode == 0 and "Traceback" not in done.stderr, done.stderr
    *reported, without_recording, rest = done.stderr.split("exit code 2\n")
    assert len(reported) == len(REFUSED) and not rest, done.stderr
    for said, text in zip(REFUSED.values(), reported):
        assert said in text
    assert "--recording" in without_recording


@pytest.fixture
def planned(tmp_path: Path) -> Path:
    """With a run in which the robot drives at 2 s and mops at 12 s; before, its battery was low."""
    scenario = RobotScenario(tmp_path)
    scenario.model.tree.set("why", "domain", DOMAIN.splitlines())
    scenario.changes("/charger", battery=4.0)
    scenario.wait(1.0)
    scenario.changes("/charger", battery=20.0)
    scenario.wait(1.0)
    scenario.runs("/m-1", [GOAL], priority=3)
    drive = "(drive d1 hall kitchen)"
    scenario.plans((drive, 0.0, 10.0), ("(mop kitchen)", 10.001, 4.0), edges=[(0, 1)])
    scenario.begins(0)
    scenario.changes(BRIDGES, remove=["(at hall)"])
    scenario.wait(10.0)
    scenario.changes(BRIDGES, add=["(at kitchen)"], battery=19.0)
    scenario.succeeds(0)
    scenario.begins(1)
    scenario.wait(4.0)
    scenario.changes(BRIDGES, add=[GOAL, "(wet kitchen)"])
    scenario.succeeds(1)
    scenario.model.settle()
    scenario.close()
    return tmp_path


def test_why_a_step_of_a_recorded_plan(planned: Path) -> None:
    """It is judged by the facts of when the plan was made, also when the step has changed them since."""
    step = ask(planned, "why", DRIVE, 5.0)
    assert "Step 1, “driving d1 to kitchen”, is there for “kitchen tidy”" in step.sentence
    assert {claim.kind for claim in step.claims} >= {"step", "link", "request"}
    assert "runs now" in step.claims[0].text and "with priority 3" in step.sentence
    running = ask(planned, "why", "", 5.0)  # what runs is meant where nothing is named
    assert running.sentence == step.sentence
    goal = ask(planned, "why", GOAL, 12.5)
    assert "Steps 1 and 2 bring “kitchen tidy” about" in goal.sentence
    with pytest.raises(QuestionError, match="there was no plan at"):
        ask(planned, "why", DRIVE, 1.5)


def test_why_a_step_of_requests_that_run_together(tmp_path: Path) -> None:
    scenario = RobotScenario(tmp_path)
    scenario.model.tree.set("why", "domain", DOMAIN.splitlines())
    scenario.runs(
        "/m-1", [GOAL], together=[QueuedGoal(request="/tablet-1", goals=["(wet kitchen)"], by="Ana")]
    )
    scenario.plans((DRIVE, 0.0, 10.0), ("(mop kitchen)", 10.001, 4.0), edges=[(0, 1)])
    scenario.begins(0)
    scenario.model.settle()
    scenario.close()
    step = ask(tmp_path, "why", DRIVE)
    asked = [claim.text for claim in step.claims if claim.kind == "request"]
    assert "is there for “kitchen tidy” and “kitchen wet”" in step.sentence
    assert len(asked) == 2 and asked[1].startswith("Ana asked for “kitchen wet”"), asked
    assert step.sentence.endswith(f"/m-1 asked for “kitchen tidy”, with priority 0. {asked[1]}")


def test_why_of_a_plan_that_was_there_before_the_knowledge_was_read(tmp_path: Path) -> None:
    scenario = RobotScenario(tmp_path)
    tell = scenario.model.tree.set
    tell("why", "domain", DOMAIN.splitlines())
    objects = dict(scenario.model.tree.get("knowledge", "objects"))
    tell("knowledge", "objects", {})
    scenario.wait(1.0)
    scenario.runs("/m-1", [GOAL])
    scenario.plans((DRIVE, 0.0, 10.0), ("(mop kitchen)", 10.001, 4.0), edges=[(0, 1)])
    tell("knowledge", "objects", objects)
    scenario.wait(1.0)
    scenario.model.settle()
    scenario.close()
    assert "is there for “kitchen tidy”" in ask(tmp_path, "why", DRIVE).sentence


def test_why_of_a_plan_for_facts_that_no_frame_has(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The drive before was cancelled at once, and the next one has begun before the monitor wrote again."""
    scenario = RobotScenario(tmp_path)
    scenario.model.tree.set("why", "domain", DOMAIN.splitlines())
    scenario.changes(BRIDGES, remove=["(at hall)"])
    scenario.wait(1.0)
    with monkeypatch.context() as unwritten:
        unwritten.setattr(scenario, "record", lambda: None)
        scenario.changes(BRIDGES, add=["(at hall)"])
        scenario.runs("/m-2", [GOAL], priority=0)
        scenario.plans(("(drive d1 hall kitchen)", 0.0, 10.0), ("(mop kitchen)", 10.001, 4.0), edges=[(0, 1)])
        scenario.begins(0)
        scenario.changes(BRIDGES, remove=["(at hall)"])
    scenario.wait(0.5)
    scenario.model.settle()
    scenario.close()
    assert "is there for “kitchen tidy”" in ask(tmp_path, "why", DRIVE, 1.6).sentence


def test_other_plans_of_a_recorded_moment(planned: Path) -> None:
    never = ask(planned, "why_not", without=["(drive d1 * *)"], goals=[GOAL], seconds=1.5)
    assert never.ok and "There is no plan without" in never.sentence
    usual = ask(planned, "what_if", goals=[GOAL], seconds=1.5)
    assert "the plan would have 2 steps" in usual.sentence
    later = ask(planned, "what_if", goals=[GOAL], seconds=5.0)  # behind the drive, which runs
    assert "the plan would have 1 step " in later.sentence
    there = ask(planned, "what_if", facts=["(at kitchen)"], goals=[GOAL], seconds=1.5)
    assert "1 step and 4.0 s instead of 2 steps" in there.sentence


def test_what_was_missing_at_a_recorded_moment(planned: Path) -> None:
    empty = ask(planned, "no_plan", goals=[GOAL], seconds=0.5)
    assert "There is no plan" in empty.sentence and "battery" in empty.sentence
    assert [claim.kind for claim in empty.claims] == ["impossible", "enough", "unknown"]


def test_a_value_that_is_no_number_is_none(tmp_path: Path) -> None:
    scenario = RobotScenario(tmp_path)
    scenario.model.tree.set("why", "domain", DOMAIN.splitlines())
    scenario.changes("/charger", battery=math.inf)
    scenario.wait(1.0)
    scenario.model.settle()
    scenario.close()
    assert ask(tmp_path, "so", "(battery)").sentence == "(battery) has no value."
    assert "does not hold" in ask(tmp_path, "so", "(>= (battery) 5)").sentence
    empty = ask(tmp_path, "no_plan", goals=["(at kitchen)"])
    assert "There is no plan" in empty.sentence and "battery" in empty.sentence


@pytest.mark.parametrize("where", [(tempfile, "mkdtemp"), (Path, "write_text")])
def test_a_full_disk_is_named(planned: Path, monkeypatch: pytest.MonkeyPatch, where: Any) -> None:
    def full(*_: Any, **__: Any) -> Any:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(*where, full)
    with pytest.raises(QuestionError, match="no file can be written .*No space left"):
        ask(planned, "what_if", goals=[GOAL], seconds=1.5)
    assert ask(planned, "doing", "", 5.0).ok  # what needs no file


def problem(more: str = "", metric: str = "") -> String:
    return String(f"(define (problem p) (:domain errands)\n(:init (at hall)\n{more})\n(:goal (and)){metric})")


@pytest.fixture
def with_problems(tmp_path: Path) -> Callable[..., RobotScenario]:
    """A scenario whose robot publishes problems, as the panel follows them; it is at its begin."""

    def begun(**planner: Any) -> RobotScenario:
        scenario = RobotScenario(tmp_path)
        domain = {"rosplan_knowledge_base/domain_path": {"text": DOMAIN}}
        parameters = {**domain, "rosplan_planner_interface": planner}
        heard: Dict[str, Any] = {}
        robot = SimpleNamespace(
            resolve=str,
            parameter=parameters.get,
            subscribe=lambda topic, kind, receive, **_: heard.update({topic: receive}),
            time_of=lambda message: scenario.now,
        )
        panel = WhyPanel(scenario.model, robot)  # type: ignore[arg-type]
        panel.start()
        panel.look({})
        hears = heard["rosplan_problem_interface/problem_instance"]
        scenario.hears = lambda message: (hears(message), scenario.record())  # type: ignore[attr-defined]
        return scenario

    return begun


def test_the_metric_of_the_recorded_problem_judges(with_problems: Any, tmp_path: Path) -> None:
    """By the battery a way through the attic is as good as any that is longer, and by the time it is not."""
    scenario = with_problems()
    scenario.changes(BRIDGES, add=["(open d2)", "(joins d2 kitchen hall)"], battery=20.0)
    scenario.hears(problem(metric="(:metric maximize (- (battery) (* 2 (total-time))))"))
    scenario.wait(1.0)
    scenario.hears(problem(metric="(:metric minimize (total-time))"))
    scenario.wait(1.0)
    scenario.model.settle()
    scenario.close()
    question = {"include": ["(drive d2 kitchen hall)"], "goals": ["(at kitchen)"]}
    judged = ask(tmp_path, "why_not", seconds=0.5, **question)
    assert "worse" in judged.sentence and "(- (battery) (* 2 (total-time)))" in judged.sentence
    by_time = ask(tmp_path, "why_not", seconds=1.5, **question)
    assert "worse" in by_time.sentence and "battery" not in by_time.sentence
    assert "unknown" not in {claim.kind for claim in (*judged.claims, *by_time.claims)}


def test_facts_that_come_true_by_themselves_count_from_their_time(with_problems: Any, tmp_path: Path) -> None:
    scenario = with_problems(anytime=0.1, time_limit=5.0, planner_command="")
    scenario.changes(BRIDGES, remove=["(open d1)"], battery=20.0)
    scenario.hears(problem("(at 30 (open d1))\n(at 90.5 (not (open d1)))"))
    scenario.runs("/m-1", [GOAL])
    scenario.plans((DRIVE, 30.001, 10.0), ("(mop kitchen)", 40.002, 4.0), edges=[(0, 1)])
    scenario.wait(10.0)
    scenario.wait(10.0)
    scenario.model.settle()
    scenario.close()
    soon = ask(tmp_path, "what_if", goals=["(at kitchen)"], seconds=0.1)
    assert "the plan would have 1 step and 4" in soon.sentence, soon
    later = ask(tmp_path, "what_if", goals=["(at kitchen)"], seconds=10.1)  # 20 s are left, and 10 s to drive
    assert "the plan would have 1 step and 3" in later.sentence, later
    assert "is there for “kitchen tidy”" in ask(tmp_path, "why", DRIVE, 15.0).sentence


def test_what_is_not_recorded_is_said_with_each_plan(planned: Path, with_problems: Any) -> None:
    answer = ask(planned, "what_if", goals=[GOAL], seconds=1.5)
    assert "are not recorded of that time" in answer.sentence and answer.claims[-1].kind == "unknown"
    assert "unknown" not in {claim.kind for claim in ask(planned, "why", DRIVE, 5.0).claims}


def test_a_program_of_the_robots_computer_does_not_plan_here(with_problems: Any, tmp_path: Path) -> None:
    ran = tmp_path / "ran"
    scenario = with_problems(planner_command=f"touch {ran} DOMAIN PROBLEM")
    scenario.hears(problem())
    scenario.wait(1.0)
    scenario.model.settle()
    scenario.close()
    answer = ask(tmp_path, "what_if", goals=["(wet kitchen)"])
    assert "the plan would have 2 steps" in answer.sentence
    assert "“touch " in answer.sentence and "is not run here" in answer.sentence
    assert not ran.exists()


def test_a_planner_that_is_not_on_this_computer_is_named(
    with_problems: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(planner_engines, "expand", lambda name: f"{name}-of-no-computer DOMAIN PROBLEM")
    scenario = with_problems(planner_command="popf")
    scenario.hears(problem())
    scenario.wait(1.0)
    scenario.model.settle()
    scenario.close()
    answer = ask(tmp_path, "what_if", goals=["(wet kitchen)"])
    assert "the plan would have 2 steps" in answer.sentence
    assert "the planner popf-of-no-computer is not installed; kairos plans instead" in answer.sentence


def test_a_metric_is_known_however_long_it_is(with_problems: Any, tmp_path: Path) -> None:
    terms = 2000  # more text than the state keeps in one piece
    long = f"(:metric maximize (- (battery) {'(+ (total-time) ' * terms}1{')' * (terms + 1)})"
    scenario = with_problems(planner_command="")
    scenario.hears(problem(metric=long))
    scenario.wait(1.0)
    panel = scenario.model.tree.get("why", "problem")
    scenario.model.settle()
    scenario.close()
    assert "".join(panel["metric"]) == long.replace(" ", "")


def test_the_command_plans_without_a_robot(planned: Path) -> None:
    reported = why(
        "--recording", str(planned), "--at", "13s", "--what-if", "(wet attic)", "--goal", "(at attic)"
    )
    assert reported.returncode == 0 and "the plan would be the same: 1 step and 10.0 s" in reported.stdout, (
        reported
    )
    wrong = why("--recording", str(planned), "--what-if", "(wett attic)", "--goal", "(at attic)")
    assert wrong.returncode == 2 and "wett" in wrong.stderr and "Traceback" not in wrong.stderr


def test_a_recording_without_a_domain_asks_for_its_file(tmp_path: Path) -> None:
    scenario = RobotScenario(tmp_path)
    scenario.runs("/m-1", [GOAL])
    scenario.model.settle()
    scenario.close()
    with pytest.raises(QuestionError, match="--domain"):
        ask(tmp_path, "doing")
    (tmp_path / "domain.pddl").write_text(DOMAIN)
    assert ask(tmp_path, "doing", domain=tmp_path / "domain.pddl").ok


def test_a_bag_is_asked_likewise(tmp_path: Path) -> None:
    parameters = {
        "/ann/merlin/panels": {"why": "merlin_explain.node.why_panel:WhyPanel"},
        "/ann/rosplan_knowledge_base/domain_path": {"file": "/gone/domain.pddl", "text": DOMAIN},
        "/ann/merlin/sentences": {"file": "/gone/sentences.yaml", "text": SENTENCES},
    }
    tidy = KnowledgeItem(knowledge_type=KnowledgeItem.FACT, attribute_name="tidy")
    tidy.values.append(KeyValue("r", "kitchen"))
    kitchen = KnowledgeItem(instance_type="room", instance_name="kitchen")
    began = ExecutorStatus(state=ExecutorStatus.RUNNING, request="/m-1", goals=[GOAL])
    result = ExecuteActionResult(
        result=ExecuteResult(outcome=ExecuteResult.ACTION_FAILED, reason="/move_base aborted: no way")
    )
    result.status.goal_id.id = "/m-1"
    reported = [
        (PARAMETERS, String(yaml.safe_dump(parameters)), 0.0),
        (KNOWLEDGE, KnowledgeChanges(cleared=True, added=[kitchen]), 0.0),
        ("merlin/status", began, 1.0),
        ("rosplan_knowledge_base/changes", KnowledgeChanges(added=[tidy], client="/sensor"), 2.0),
        ("merlin/execute/result", result, 5.0),
        ("merlin/status", ExecutorStatus(), 5.0),
    ]
    with rosbag.Bag(str(tmp_path / BAG), "w") as bag:
        for topic, message, after in reported:
            at = genpy.Time.from_sec(BEGIN + after)
            if message._has_header:
                message.header.stamp = at
            bag.write(f"/ann/{topic}", message, at)
    assert "/move_base aborted: “no way”" in ask(tmp_path, "failed").sentence
    so = ask(tmp_path, "so", GOAL)
    assert "the kitchen is tidy" in so.sentence and "by /sensor" in so.sentence


def test_sentences_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    scenario = RobotScenario(tmp_path)
    scenario.model.tree.set("why", "domain", DOMAIN.splitlines())
    scenario.model.tree.set("why", "sentences", ["["])
    scenario.runs("/m-1", [GOAL])
    scenario.model.settle()
    scenario.close()
    with pytest.raises(QuestionError, match="sentences"):
        ask(tmp_path, "doing")

# SPDX-License-Identifier: Apache-2.0
"""Whether an application fits its robots is said in one sentence for each mistake."""

from pathlib import Path
from typing import Dict, List

import pytest

from merlin_actions.core.application_check import ApplicationWorld, Needs
from merlin_actions.core.robot_check import check_robots, robot_parameters, unnamed_robots
from merlin_pddl.domain_reader import read_domain
from merlin_pddl.problem_reader import read_problem

ROBOTS = Path(__file__).resolve().parents[4] / "pddl" / "robots"
CLEARED = "(at start (not (available ?r)))"
WAITS = "drive needs (available ?r) of its robot, and no robot is named: start it with "
WAIT = Needs("Wait", "wait", ("to",))
DRIVE = Needs("Drive", "drive", ("r", "from", "to"))
OBJECTS = {"robot": ["ann", "bob"], "place": ["kitchen"], "object": ["ann", "bob", "kitchen"]}
WORLD = ApplicationWorld(
    {
        "drive": [("r", "robot"), ("from", "place"), ("to", "place")],
        "lift": [("r", "robot"), ("s", "robot")],
        "wait": [("to", "place")],
    },
    lambda kind: OBJECTS.get(kind, []),
    ["kitchen"],
    parents={"robot": "object", "place": "object"},
)


@pytest.mark.parametrize(
    ("domain", "problem", "said"),
    [
        ({}, {}, [f"{WAITS}robots:=ann,bob"]),
        ({"(at end (visited ?to))": f"{CLEARED} (at end (visited ?to))"}, {}, []),  # plans change it
        ({"(at start (available ?r)) ": ""}, {}, []),
        ({"(available ?r - robot) ": "(available) ", "(available ?r))": "(available))"}, {}, []),
        ({}, {"(robot_at ann anywhere)": "(robot_at ann anywhere) (available ann)"}, []),
    ],
)
def test_an_application_that_names_no_robots_may_wait_for_one(
    tmp_path: Path, domain: Dict[str, str], problem: Dict[str, str], said: List[str]
) -> None:
    for name, changes in (("domain.pddl", domain), ("problem.pddl", problem)):
        text = (ROBOTS / name).read_text(encoding="utf-8")
        for old, new in changes.items():
            assert old in text
            text = text.replace(old, new)
        (tmp_path / name).write_text(text, encoding="utf-8")
    read = read_domain(tmp_path / "domain.pddl")
    assert unnamed_robots(read, read_problem(tmp_path / "problem.pddl", read)) == said


@pytest.mark.parametrize(
    ("needs", "robots", "said"),
    [
        (DRIVE, ["ann", "bob"], []),
        (DRIVE, [], []),
        (DRIVE, ["ann", "ann"], ["robot ann is named twice"]),
        (DRIVE, ["ann", "eve"], ["robot eve is not an object of the problem, as ?r of drive"]),
        (DRIVE, ["kitchen"], ["robot kitchen is of type place, not robot, as ?r of drive"]),
        (DRIVE._replace(concurrent=2), ["ann"], ["Drive runs on a robot, one at a time"]),
        (DRIVE._replace(concurrent=2), [], []),
        (DRIVE._replace(robot_parameter="q"), [], ["Drive: robot_parameter is 'q', but operator drive has"]),
        (Needs("Lift", "lift", ("r", "s")), ["ann"], ["Lift: operator lift has the robots ?r and ?s; say"]),
        (WAIT, ["ann", "bob"], ["no action has a parameter of type robot: nothing runs on ann, bob"]),
        (WAIT, [], []),
    ],
)
def test_what_does_not_fit_is_one_sentence(needs: Needs, robots: List[str], said: List[str]) -> None:
    found = check_robots([needs], WORLD, robots)
    assert len(found) == len(said)
    assert all(sentence.startswith(start) for sentence, start in zip(found, said)), found


def test_which_parameter_names_the_robot() -> None:
    unclear = Needs("Lift", "lift", ("r", "s"))
    assert robot_parameters([DRIVE, WAIT, unclear], WORLD) == {"drive": "r"}
    assert robot_parameters([unclear._replace(robot_parameter="s")], WORLD) == {"lift": "s"}

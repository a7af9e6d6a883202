# SPDX-License-Identifier: Apache-2.0
"""What `rosrun merlin new` writes and refuses, without building it."""

import re
import shlex
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from merlin.new import command
from merlin.new.application import SPEED, TURNING, ApplicationRefused, application_of, new_application
from merlin.new.names import NameRefused, check_operator, check_package, class_name, needs_operator
from merlin.new.package_writer import files_of, write_application
from merlin.new.robots_added import with_robots
from merlin_actions.core.names import snake_case
from merlin_monitor.text.sentences import domain_faults, read_sentences
from merlin_pddl.domain import used_predicates
from merlin_pddl.domain_reader import parse_domain, read_domain
from merlin_pddl.problem_reader import parse_problem, read_problem
from merlin_pddl.text_reader import PddlError
from merlin_rosplan.knowledge.executions import Executions
from merlin_rosplan.knowledge.knowledge_store import KnowledgeStore

PDDL = Path(__file__).parents[3] / "pddl"
LONG = "a" * 29
SPECS = [
    ["fetch ?o - object ?from ?to - place", "(place ?o - object ?where - poi)"],
    ["wave"],
    ["look-at ?p - poi ?q - poi ?r - poi", "load_2 ?my-box - object", "a ?x ?y - place"],
    [f"{LONG}a " + " ".join(f"?{LONG}{i} - object" for i in range(8))],
    [],
]


def package_of(folder, *specs, types=()):
    return write_application(new_application("my_robot", specs, types), folder / "ws", "/usr/bin/python3")


@pytest.mark.parametrize("specs", SPECS, ids=str)
def test_the_written_pddl_is_valid_and_python_passes_ruff(specs, tmp_path):
    package = package_of(tmp_path, *specs)
    domain = read_domain(package / "pddl" / "domain.pddl")
    parse_problem((package / "pddl" / "problem.pddl").read_text(), domain)
    sentences = package / "pddl" / "sentences.yaml"
    assert not read_sentences(sentences).operators, "all of it are comments"
    sentences.write_text(re.sub("(?m)^  # ", "  ", sentences.read_text()))
    written = read_sentences(sentences)
    assert (set(written.operators), set(written.goals)) == (set(domain.operators), set(domain.predicates))
    signatures = {
        group: {name: [(each.label, "") for each in one.parameters] for name, one in named.items()}
        for group, named in (("operators", domain.operators), ("predicates", domain.predicates))
    }
    assert domain_faults(written, {**signatures, "functions": {}}) == []
    assert len(domain.operators) == max(1, len(specs)) + 1
    for words in (["check"], ["format", "--check"]):
        ruff = subprocess.run(
            [sys.executable, "-m", "ruff", *words, str(package)], capture_output=True, text=True, check=False
        )
        assert ruff.returncode == 0, ruff.stdout + ruff.stderr


@pytest.mark.parametrize("specs", SPECS, ids=str)
def test_each_class_leads_to_its_operator(specs):
    for action in new_application("my_robot", specs).actions:
        if not needs_operator(action.operator):
            assert snake_case(class_name(action.operator)) == action.operator


def test_numbered_actions_are_imported_in_ruffs_order(tmp_path):
    package = package_of(tmp_path, "load_10 ?p - poi", "load_2 ?p - poi")
    ruff = [sys.executable, "-m", "ruff", "check", str(package)]
    assert subprocess.run(ruff, capture_output=True, check=False).returncode == 0


def test_the_launch_file_of_four_actions_has_at_most_fifteen_lines():
    application = new_application(
        "hospital_courier", [f"action_{word} ?p - poi" for word in ["one", "two", "six", "ten"]]
    )
    assert len(files_of(application)["launch/hospital_courier.launch"].splitlines()) <= 15


def test_the_times_of_the_problem_are_those_of_the_world():
    application = new_application("my_robot", ["greet ?p - poi"])
    world = yaml.safe_load(files_of(application)["worlds/my_robot.yaml"])
    points = world["points_of_interest"]
    distance = points["kitchen"]["x"] - points["hall"]["x"]
    assert ("hall", "kitchen", round(distance / SPEED + TURNING, 1)) in application.times()


def test_types_of_the_user_get_objects_and_places_become_points():
    application = new_application("my_robot", ["put ?b ?c - box ?s - shelf"], ["box - object", "shelf - poi"])
    assert application.objects == {"box_1": "box", "box_2": "box", "shelf_1": "shelf"}
    assert application.goals == ["(put_done box_1 box_2 shelf_1)"]
    assert "shelf_1" in application.places
    files = files_of(application)
    domain = parse_domain(files["pddl/domain.pddl"])
    assert parse_problem(files["pddl/problem.pddl"], domain).objects["shelf_1"] == ("shelf",)


def test_a_domain_that_exists_is_kept_as_it_is(tmp_path):
    domain, problem = (PDDL / "restaurant" / f"{name}.pddl" for name in ("domain", "problem"))
    application = application_of("my_cafe", domain, problem)
    package = write_application(application, tmp_path / "ws", "python3")
    assert (package / "pddl" / "domain.pddl").read_text() == domain.read_text()
    operators = {action.operator for action in application.actions}
    assert operators == set(read_domain(domain).operators) - {"navigate"} and application.navigates
    assert {"table_1", "table_6", "bar", "entrance"} <= set(application.points)  # objects and constants
    assert "anywhere" not in application.points
    assert (package / "src" / "my_cafe" / "actions" / "order_to_barman.py").is_file()


def test_a_navigate_of_the_domain_that_is_not_that_of_merlin_gets_a_class(tmp_path):
    domain, problem = tmp_path / "domain.pddl", tmp_path / "problem.pddl"
    domain.write_text(
        "(define (domain lab) (:requirements :typing) (:types bench - object)\n"
        "(:predicates (robot_at ?b - bench))\n(:action navigate :parameters (?from ?to - bench)\n"
        ":precondition (robot_at ?from) :effect (robot_at ?to)))"
    )
    problem.write_text(
        "(define (problem p) (:domain lab) (:objects a b - bench) (:init (robot_at a)) (:goal (robot_at b)))"
    )
    application = application_of("my_lab", domain, problem)
    assert [(action.operator, action.parameters) for action in application.actions] == [
        ("navigate", ("from", "to"))
    ]
    assert "[my_lab.actions.navigate:Navigate]" in files_of(application)["launch/my_lab.launch"]


@pytest.mark.parametrize(
    "name", ["", "a", "My", "2a", "a-b", "a__b", "class", "json", "test", "all", "merlin_sm", "x" * 31]
)
def test_names_that_cannot_be_packages_are_refused(name):
    with pytest.raises(NameRefused):
        check_package(name, known=["merlin_sm"])


@pytest.mark.parametrize(
    "name", ["", "Fetch", "import", "none", "true", "when", "at", "navigate", "robot_at", "2x", "f?"]
)
def test_names_that_cannot_be_actions_are_refused(name):
    with pytest.raises(NameRefused):
        check_operator(name)


@pytest.mark.parametrize(
    ("specs", "types", "said"),
    [
        (["f ?x ?x"], [], "stands twice"),
        (["f ?x - bax"], [], "unknown type 'bax'; --type"),
        (["f x"], [], "expected a variable"),
        (["(f ?x"], [], "never closed"),
        ([""], [], "begins with its name"),
        (["f ?duration"], [], "keyword of PDDL"),
        (["f ?x - (either poi place)"], [], "one type"),
        (["f-a", "f_a"], [], "would be one class"),
        (["f", "f"], [], "would be one class"),
        (["f", "f_done"], [], "predicate of 'f'"),
        (["f " + " ".join(f"?p{i}" for i in range(9))], [], "the most is 8"),
        (["f"], ["poi - object"], "already"),
        (["f"], ["shelf - place"], "write '- poi'"),
        (["f"], ["shelf - room"], "unknown type 'room'"),
        (["f"], ["and - object"], "keyword of PDDL"),
    ],
)
def test_text_that_is_not_an_action_or_a_type_is_refused_with_the_reason(specs, types, said):
    with pytest.raises((ApplicationRefused, NameRefused), match=None) as error:
        new_application("my_robot", specs, types)
    assert said in str(error.value)


@pytest.mark.parametrize(
    ("changes", "servers"),
    [
        ({}, ("move_base", "sound_play")),
        ({"navigates": False}, ("sound_play",)),
        ({"actions": []}, ("move_base",)),
        ({"actions": [], "navigates": False}, ()),
    ],
)
def test_the_mission_names_the_servers_that_its_actions_use(changes, servers):
    application = replace(new_application("my_robot", []), **changes)
    written: dict = {}
    exec(files_of(application)["src/my_robot/mission.py"], written)
    assert written["MyRobotMission"].servers == servers


def test_its_readme_starts_it_on_the_master_of_the_robot(tmp_path):
    text = (package_of(tmp_path) / "README.md").read_text()
    assert "roslaunch my_robot my_robot.launch on:=robot" in text
    assert "merlin run my_robot my_robot.launch on:=robot" not in text


@pytest.mark.parametrize("new", [True, False], ids=["a new workspace", "an old workspace"])
def test_of_two_that_write_one_package_at_once_the_second_is_refused(tmp_path, monkeypatch, new):
    if not new:
        (tmp_path / "ws" / "src").mkdir(parents=True)
    rename = Path.rename

    def meanwhile(source, target):
        monkeypatch.setattr(Path, "rename", rename)
        package_of(tmp_path)
        return rename(source, target)

    monkeypatch.setattr(Path, "rename", meanwhile)
    with pytest.raises(ApplicationRefused, match="ws.* has come meanwhile; nothing is overwritten"):
        package_of(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["ws"]
    assert [path.name for path in (tmp_path / "ws").iterdir()] == ["src"]


def test_nothing_is_overwritten(tmp_path):
    package = package_of(tmp_path)
    (package / "README.md").write_text("mine")
    with pytest.raises(ApplicationRefused, match="nothing is overwritten"):
        package_of(tmp_path)
    assert (package / "README.md").read_text() == "mine"
    other = write_application(new_application("other", []), tmp_path / "ws")
    assert other.is_dir() and sorted(path.name for path in (tmp_path / "ws" / "src").iterdir()) == [
        "my_robot",
        "other",
    ]
    (tmp_path / "taken").mkdir()
    with pytest.raises(ApplicationRefused, match="not a catkin workspace"):
        write_application(new_application("other", []), tmp_path / "taken")


def test_nothing_is_left_when_writing_fails(tmp_path, monkeypatch):
    written = []

    def write(self, text, encoding=None):
        written.append(self)
        if len(written) == 9:
            raise OSError(28, "No space left on device")
        return len(text)

    monkeypatch.setattr(Path, "chmod", lambda self, mode: None)
    monkeypatch.setattr(Path, "write_text", write)
    monkeypatch.chdir(tmp_path)
    assert command.main(["my_robot"]) == 2
    assert len(written) == 9 and not list(tmp_path.iterdir())


def test_a_goal_that_no_mission_can_send_is_refused(tmp_path):
    problem = tmp_path / "problem.pddl"
    text = (PDDL / "home" / "problem.pddl").read_text()
    problem.write_text(text.replace("(:goal (in_service))", "(:goal (or (in_service) (checked kitchen)))"))
    with pytest.raises(ApplicationRefused, match="neither"):
        application_of("my_home", PDDL / "home" / "domain.pddl", problem)
    problem.write_text("(define")
    with pytest.raises(PddlError):
        application_of("my_home", PDDL / "home" / "domain.pddl", problem)


@pytest.mark.parametrize(
    "words",
    [["--problem", "p"], ["--from-domain", "d"], ["--from-domain", "d", "--problem", "p", "--action", "f"]],
)
def test_options_that_do_not_fit_are_refused(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert command.main(["my_robot", *words]) == 2
    assert capsys.readouterr().err.startswith("merlin new: ") and not list(tmp_path.iterdir())


def test_the_commands_that_it_prints_stand_a_blank_in_the_path(tmp_path, capsys):
    workspace = tmp_path / "my own"
    assert command.main(["my_robot", "--workspace", str(workspace)]) == 0
    said = capsys.readouterr()
    (line,) = [line for line in said.out.splitlines() if "catkin_make" in line]
    assert shlex.split(line)[:3] == ["cd", str(workspace), "&&"]
    assert f"warning: the path '{workspace}' has a blank" in said.err and "run_tests" in said.err
    assert command.main(["my_robot", "--workspace", str(tmp_path / "own")]) == 0
    assert not capsys.readouterr().err


@pytest.mark.parametrize("specs", [["greet ?p - poi", "wave"], []], ids=str)
def test_several_robots_are_in_domain_problem_world_and_launch_file(specs, tmp_path):
    application = new_application("my_robots", specs, (), ["ria", "tom"])
    package = write_application(application, tmp_path / "ws", "python3")
    domain = read_domain(package / "pddl" / "domain.pddl")
    problem = read_problem(package / "pddl" / "problem.pddl", domain)
    assert all(operator.parameters[0].types == ("robot",) for operator in domain.operators.values())
    assert [name for name, types in problem.objects.items() if types == ("robot",)] == ["ria", "tom"]
    assert ("robot_at", ("tom", "anywhere")) in [(fact.name, fact.args) for fact in problem.facts]
    world = yaml.safe_load((package / "worlds" / "my_robots.yaml").read_text())
    (first, second) = world["starts"]
    assert abs(first["x"] - second["x"]) > 1.0  # m; they do not touch
    assert 'name="robots" default="ria,tom"' in (package / "launch" / "my_robots.launch").read_text()
    assert application.actions[0].parameters == (("p",) if specs else application.actions[0].parameters)
    for words in (["check"], ["format", "--check"]):
        ruff = [sys.executable, "-m", "ruff", *words, str(package)]
        assert subprocess.run(ruff, capture_output=True, check=False).returncode == 0


def test_a_robot_that_is_stopped_leaves_no_place_closed_for_ever(tmp_path):
    application = new_application("my_robots", ["greet ?p - poi"], (), ["ria", "tom"])
    package = write_application(application, tmp_path / "ws", "python3")
    assert "[my_robots.actions.navigate:Navigate, " in (package / "launch/my_robots.launch").read_text()
    written = {}
    exec((package / "src/my_robots/actions/navigate.py").read_text(), written)
    declared = [
        text.replace("?to", "hall").replace("(robot_at ", "(robot_at ria ")  # as the bridges do
        for text in written["Navigate"].if_interrupted
    ]
    store = KnowledgeStore(read_domain(package / "pddl/domain.pddl"))
    store.load_problem(read_problem(package / "pddl/problem.pddl", store.domain))
    before = sorted(fact.text() for name in ("free", "robot_at") for fact in store.facts(name))
    with store.transaction() as change:
        way = {"r": "ria", "from": "anywhere", "to": "hall"}
        Executions(change).start("one", "navigate", way, if_interrupted=declared)
    with store.transaction() as change:
        Executions(change).interrupt("one")
    after = sorted(fact.text() for name in ("free", "robot_at") for fact in store.facts(name))
    assert set(before) <= set(after)


@pytest.mark.parametrize("folder", ["home", "restaurant"])
def test_a_domain_of_one_robot_gets_robots_and_keeps_the_rest(folder, tmp_path):
    domain, problem = (PDDL / folder / f"{name}.pddl" for name in ("domain", "problem"))
    application = application_of("two", domain, problem, ["ria", "tom"])
    assert application.navigates and application.robots == ["ria", "tom"]
    found = parse_domain(application.domain_text)
    before = read_domain(domain)
    for name, operator in found.operators.items():
        labels = [each.label for each in operator.parameters]
        assert labels == ["r", *(each.label for each in before.operators[name].parameters)]
        assert "(available ?r)" in application.domain_text
    assert [each.label for each in found.predicates["robot_at"].parameters][0] == "r"
    facts = {(fact.name, *fact.args) for fact in parse_problem(application.problem_text, found).facts}
    begins = next(f.args for f in read_problem(problem, before).facts if f.name == "robot_at")
    assert {("robot_at", "ria", *begins), ("robot_at", "tom", *begins), ("available", "tom")} <= facts
    assert application.domain_text.count(";") == domain.read_text().count(";")
    assert all("r" not in action.parameters for action in application.actions)


def test_an_object_that_is_no_robot_gives_no_robot_its_name():
    domain, problem = (PDDL / "home" / f"{name}.pddl" for name in ("domain", "problem"))
    with pytest.raises(ApplicationRefused, match="anywhere is an object already"):
        application_of("two", domain, problem, ["bob", "anywhere"])


def test_each_operator_asks_that_its_robot_is_available():
    text = "(define (domain lab) (:types b - object) (:predicates (robot_at ?b - b) (done))\n"
    text += "(:action wave :parameters () :effect (done))\n"
    text += "(:durative-action turn :parameters () :duration (= ?duration 1) :effect (at end (done))))"
    problem = "(define (problem p) (:domain lab) (:objects) (:init) (:goal (done)))"
    found = parse_domain(with_robots(text, problem, ["ria"], ("domain", "problem"))[0])
    for operator in found.operators.values():
        (asked,) = operator.conditions
        assert used_predicates(asked.condition) == {("available", False)}


def test_the_world_has_places_of_any_name(tmp_path):
    domain, problem = tmp_path / "domain.pddl", tmp_path / "problem.pddl"
    domain.write_text((PDDL / "home" / "domain.pddl").read_text())
    problem.write_text((PDDL / "home" / "problem.pddl").read_text().replace("kitchen", "no"))
    written = files_of(application_of("my_home", domain, problem))["worlds/my_home.yaml"]
    assert "no" in yaml.safe_load(written)["points_of_interest"]


def test_a_domain_of_several_robots_is_kept_and_has_to_know_them(tmp_path):
    domain, problem = (PDDL / "home" / f"robots{name}.pddl" for name in ("", "_problem"))
    text = problem.read_text().replace("(:goal (robot_at ann anywhere))", "(:goal (checked kitchen))")
    copy = tmp_path / "problem.pddl"
    copy.write_text(text)
    application = application_of("two", domain, copy, ["ann", "bob"])
    assert application.domain_text == domain.read_text()
    assert [action.parameters for action in application.actions] == [("p",)] and application.navigates
    with pytest.raises(ApplicationRefused, match="has no object carl of type robot"):
        application_of("two", domain, copy, ["ann", "carl"])


@pytest.mark.parametrize(
    ("robots", "specs", "said"),
    [
        ("Ria", ["f"], "robot 'Ria': a name has lower case"),
        ("ria ria", ["f"], "named twice"),
        ("and", ["f"], "keyword of PDDL"),
        ("hall", ["f"], "hall is an object already"),
        ("bob anywhere", ["f"], "anywhere is an object already"),
        ("yes no", ["f"], "robot 'yes': YAML reads it as True"),
        ("ria tom", ["f ?r - poi"], "--robots adds the robot, as ?r"),
        ("ria tom", ["f ?x - robot"], "--robots adds the robot, as ?r"),
        ("a b c d e f", ["f"], "6 robots; at most 5"),
    ],
)
def test_robots_that_cannot_be_are_refused_with_the_reason(robots, specs, said):
    with pytest.raises((ApplicationRefused, NameRefused)) as error:
        new_application("my_robots", specs, (), robots.split())
    assert said in str(error.value)


@pytest.mark.parametrize(
    ("instead", "said"),
    [
        (("(:goal (in_service))", "(:goal (robot_at kitchen))"), "the goal (robot_at kitchen) does not say"),
        (
            ("?p - poi)\n    :duration (= ?duration 5)", "?r - poi)\n    :duration (= ?duration 5)"),
            "ask has a ?r",
        ),
        (("(:types", "(:kinds"), "there is no (:types …)"),
        (("(in_service) ", "(available ?p - poi) "), "(available …) is what --robots adds"),
    ],
)
def test_where_the_robot_is_not_clear_it_is_said(instead, said, tmp_path):
    files = []
    for name in ("domain", "problem"):
        text = (PDDL / "home" / f"{name}.pddl").read_text().replace(*instead)
        files.append(tmp_path / f"{name}.pddl")
        files[-1].write_text(text)
    with pytest.raises(PddlError, match=re.escape(said)):
        with_robots(*(file.read_text() for file in files), ["ria"], ("domain", "problem"))

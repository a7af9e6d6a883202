# SPDX-License-Identifier: Apache-2.0
"""planning:=, dispatcher:=, planner_command:= and robots:= of the applications' launch files."""

import re
import shlex
import subprocess
from pathlib import Path

import pytest
import rospkg
from roslaunch.config import ROSLaunchConfig
from roslaunch.core import RLException
from roslaunch.xmlloader import XmlLoader

from merlin.launch_config import LaunchConfig
from merlin.launch_request import LaunchError, LaunchRequest, known_arguments
from merlin_actions.merlin_action_server import CANCEL_LIMIT
from merlin_restaurant.recorded_evening import RecordedEvening

LAUNCH = Path(rospkg.RosPack().get_path("merlin")) / "launch"
ROBOT = {
    "domain_path": "/d.pddl",
    "problem_path": "/p.pddl",
    "points_of_interest": str(Path(__file__).parents[2] / "data" / "points_of_interest.yaml"),
    "actions": "[]",
}
FILES = {"home.launch": {}, "restaurant.launch": {}, "include/robot.launch": ROBOT}
COMPONENTS = {
    "rosplan_knowledge_base": "knowledgeBase",
    "rosplan_problem_interface": "problemInterface",
    "rosplan_planner_interface": "popf_planner_interface",
    "rosplan_parsing_interface": "pddl_{}_plan_parser",
    "rosplan_plan_dispatcher": "pddl_{}_plan_dispatcher",
}


def load(file, **arguments):
    inner = "".join(f'<arg name="{name}" value="{value}"/>' for name, value in arguments.items())
    config = ROSLaunchConfig()
    text = f'<launch><include file="{LAUNCH / file}">{inner}</include></launch>'
    XmlLoader(resolve_anon=False).load_string(text, config)
    return config


@pytest.mark.parametrize("file, arguments", FILES.items())
@pytest.mark.parametrize("dispatcher", ["simple", "esterel"])
def test_merlin_plans_unless_told_otherwise(file, arguments, dispatcher):
    config = load(file, **arguments, dispatcher=dispatcher, planner_command="popf DOMAIN PROBLEM")
    assert [node.name for node in config.nodes if node.name.startswith(("planning", "rosplan"))] == [
        "planning_system"
    ]
    components = {
        name.rsplit("/", 1)[1]: parameter.value
        for name, parameter in config.params.items()
        if name.startswith("/planning_system/components/")
    }
    assert components["rosplan_plan_dispatcher"] == f"{dispatcher}_plan_dispatcher"
    assert config.params["/rosplan_planner_interface/planner_command"].value == "popf DOMAIN PROBLEM"


@pytest.mark.parametrize("file, arguments", FILES.items())
@pytest.mark.parametrize("dispatcher", ["simple", "esterel"])
def test_rosplan_plans_when_asked_to(file, arguments, dispatcher):
    config = load(file, **arguments, planning="rosplan", dispatcher=dispatcher)
    nodes = {node.name: node for node in config.nodes if node.name.startswith(("planning", "rosplan"))}
    wanted = {name: kind.format(dispatcher) for name, kind in COMPONENTS.items()}
    assert {name: node.type for name, node in nodes.items()} == wanted
    values = {name: parameter.value for name, parameter in config.params.items()}
    assert values["/rosplan_plan_dispatcher/timeout_actions"] is False
    assert values["/rosplan_planner_interface/use_problem_topic"] is True
    assert values["/rosplan_planner_interface/planner_command"].endswith("popf DOMAIN PROBLEM")
    assert (
        values["/rosplan_planner_interface/problem_path"] == values["/rosplan_problem_interface/problem_path"]
    )
    topics = [
        value for name, value in values.items() if name.endswith("_topic") and name.startswith("/rosplan_")
    ]
    assert "/rosplan_planner_interface/planner_output" in topics
    assert "/rosplan_parsing_interface/complete_plan" in topics


def test_names_carry_the_robot():
    config = load("home.launch", robot="one", planning="rosplan")
    values = {name: parameter.value for name, parameter in config.params.items()}
    for node in ("rosplan_parsing_interface", "rosplan_plan_dispatcher", "rosplan_problem_interface"):
        assert values[f"/one/{node}/knowledge_base"] == "one/rosplan_knowledge_base"
    assert values["/one/rosplan_plan_dispatcher/plan_topic"] == "/one/rosplan_parsing_interface/complete_plan"


def test_another_planning_system_does_not_exist():
    with pytest.raises((RLException, OSError), match="somebody.launch"):
        load("home.launch", planning="somebody")


def test_our_own_nodes_are_refused_with_a_sentence():
    prefix = LAUNCH.parent / "scripts" / "rosplan_node"
    for package, executable in (
        ("rosplan_knowledge_base", "knowledgeBase"),
        ("rosplan_planning_system", "pddl_simple_plan_dispatcher"),
    ):
        script = Path(rospkg.RosPack().get_path(package)) / "scripts" / executable
        done = subprocess.run([prefix, script, "__name:=x"], capture_output=True, text=True)
        assert done.returncode == 2 and "needs ROSPlan's own nodes" in done.stderr
    done = subprocess.run([prefix, "/bin/echo", "a node of its own"], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "a node of its own\n")


# --- robots:=: names between commas or blanks, with or without brackets and quotes -------------------

ROBOTS = {
    "domain_path": LAUNCH.parent / "pddl/robots/domain.pddl",
    "problem_path": LAUNCH.parent / "pddl/robots/problem.pddl",
    "actions": "[merlin_actions.actions.drive:Drive]",
}


@pytest.mark.parametrize("robots", ["ann,bob", "ann bob", " ann,  bob ", "[ann, bob]", "['ann', 'bob']"])
@pytest.mark.parametrize(
    "file, arguments", [("include/application.launch", ROBOTS), ("restaurant.launch", {})]
)
def test_each_robot_has_a_host_and_stands_in_the_world(file, arguments, robots):
    config = load(file, **arguments, robots=robots)
    hosts = [node.namespace for node in config.nodes if node.type == "fsm_host"]
    assert sorted(set(hosts) - {"/"}) == ["/ann/", "/bob/"]
    assert config.params["/ann/merlin_fsm_host/robot"].value == "ann"
    assert config.params["/merlin_sim/robots"].value == ["ann", "bob"]


@pytest.mark.parametrize(
    "file, arguments",
    [("include/application.launch", ROBOTS), ("restaurant.launch", {}), ("include/robot.launch", ROBOT)],
)
def test_each_robot_hears_what_it_is_asked_aloud(file, arguments):
    config = load(file, **arguments, robots="ann,bob", voice_questions="true")
    ears = [node.namespace for node in config.nodes if node.type == "voice_questions"]
    assert sorted(ears) == ["/ann/", "/bob/"]
    assert config.params["/ann/voice_questions/robot"].value == "ann"
    assert config.params["/bob/voice_questions/explain"].value == "/merlin/explain"
    alone = load(file, **arguments, voice_questions="true")
    assert [node.namespace for node in alone.nodes if node.type == "voice_questions"] == ["/"]


@pytest.mark.parametrize("robots", ["", "[]", " "])
def test_none_is_one_robot_without_a_name(robots):
    config = load("include/application.launch", **ROBOTS, robots=robots)
    assert {node.namespace for node in config.nodes if node.type == "fsm_host"} == {"/"}


# --- what the velocity guard is told of the base -------------------------------------------------------

LIMITS = (
    "max_speed",
    "max_turn_speed",
    "max_acceleration",
    "max_turn_acceleration",
    "max_jerk",
    "max_turn_jerk",
    "base_timeout",
)


def of_base(config, robot=""):
    return [config.params[f"{robot}/merlin_guard/{name}"].value for name in LIMITS]


@pytest.mark.parametrize(
    "file, arguments, robot",
    [
        ("home.launch", {}, ""),
        ("restaurant.launch", {}, ""),
        ("restaurant.launch", {"robots": "ann,bob"}, "/bob"),
        ("include/application.launch", {**ROBOTS, "on": "simulator"}, ""),
        ("include/application.launch", {**ROBOTS, "on": "simulator", "robots": "ann,bob"}, "/ann"),
    ],
)
def test_of_the_simulated_base_all_is_known_and_nothing_that_it_does_is_limited(file, arguments, robot):
    from merlin_sim.engine.simulation import RobotSpec
    from merlin_sim.robot.diff_drive import DriveLimits

    speed, turn_speed, *others, timeout = of_base(load(file, **arguments), robot)
    assert (speed, turn_speed) == (DriveLimits.speed, DriveLimits.turn_speed)
    assert others == ["inf"] * 4 and timeout == RobotSpec.command_timeout


@pytest.mark.parametrize("robots, robot", [("", ""), ("ann,bob", "/bob")])
def test_of_a_robot_only_what_somebody_has_said_is_known(robots, robot):
    file, arguments = "include/robot.launch", {**ROBOT, "robots": robots}
    assert of_base(load(file, **arguments), robot) == [""] * 7
    given = dict(zip(LIMITS, (0.5, 1.5, 0.8, "inf", 4.0, 8.0, 0.25)))
    config = load(file, **arguments, **given, over_limit="refuse")
    assert of_base(config, robot) == list(given.values())
    assert config.params[f"{robot}/merlin_guard/over_limit"].value == "refuse"


def test_an_application_of_a_robot_needs_no_simulator(tmp_path: Path):
    """A computer with the profile robot has no merlin_sim."""
    file = tmp_path / "application.launch"
    text = (LAUNCH / "include" / file.name).read_text(encoding="utf-8")
    file.write_text(re.sub(r"merlin_sim\b", "nowhere", text), encoding="utf-8")
    assert "world_file" in known_arguments(file)
    config = load(file, on="robot", world_file=ROBOT["points_of_interest"])
    assert "/world/points_of_interest/kitchen/x" in config.params


@pytest.mark.parametrize("on", ["simulator", "servers"])
@pytest.mark.parametrize("robots", ["", "ann,bob"])
def test_one_seed_is_that_of_all_that_is_simulated(on: str, robots: str) -> None:
    config = load("include/application.launch", on=on, robots=robots, seed="7", answers="[yes]", arm="true")
    seeds = {name: parameter.value for name, parameter in config.params.items() if name.endswith("/seed")}
    assert len(seeds) >= 2 and set(seeds.values()) == {7}, seeds


def test_an_application_takes_the_arguments_of_a_robot() -> None:
    """A robot in a simulator that is not MERLIN's, another planner, and a folder of its own."""
    config = LaunchConfig(
        LaunchRequest.from_command_line(
            [
                *("merlin", "application.launch", "on:=robot", f"world_file:={ROBOT['points_of_interest']}"),
                *("use_sim_time:=true", "planner_command:=popf", "robot:=fetch_1", "max_replans:=1"),
            ]
        )
    )
    assert config.param("/use_sim_time") is True
    assert config.param("/rosplan_planner_interface/planner_command") == "popf"
    assert config.param("/merlin_executor/max_replans") == 1
    state = config.param("/rosplan_knowledge_base/state_file")
    assert state.endswith("/merlin/fetch_1/knowledge.sqlite")


@pytest.mark.parametrize("arguments", [{"reset_state": "true"}, {}], ids=["reset", "kept"])
@pytest.mark.parametrize(
    ("file", "needed"),
    [
        *FILES.items(),
        ("include/application.launch", {"on": "robot", "world_file": ROBOT["points_of_interest"]}),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_each_application_can_begin_with_its_problem_again(file: str, needed: dict, arguments: dict) -> None:
    if file != "include/application.launch":  # which keeps what a robot knows without being told to
        needed = {**needed, "state_file": "/tmp/knowledge.sqlite"}
    config = load(file, **needed, **arguments)
    (reset,) = (each.value for name, each in config.params.items() if name.endswith("/reset_state"))
    assert reset is bool(arguments)


def test_a_name_that_the_file_sets_to_nothing_is_no_argument(tmp_path: Path):
    """`others` of robots.launch is empty for one robot."""
    with pytest.raises(LaunchError) as error:
        LaunchRequest.from_command_line(["merlin", "robots.launch"])
    assert str(error.value) == "robots.launch needs points_of_interest:=…"
    with pytest.raises(LaunchError, match="robots.launch has no argument 'others'"):
        LaunchRequest.from_command_line(["merlin", "robots.launch", "points_of_interest:=x", "others:=ann"])
    file = tmp_path / "grouped.launch"
    file.write_text(
        '<launch><arg name="given" default=""/><group><arg name="fixed" value=""/></group></launch>',
        encoding="utf-8",
    )
    assert known_arguments(file) == {"given": ""}


def test_an_argument_with_two_values_is_refused() -> None:
    home = ["home.launch", "simulator:=true"]
    assert LaunchRequest.from_command_line([*home, "simulator:=true"]).arguments == {"simulator": "true"}
    with pytest.raises(LaunchError, match="simulator:=true and simulator:=false contradict each other"):
        LaunchRequest.from_command_line([*home, "simulator:=false"])


@pytest.mark.parametrize("word", ["state_file:=", "state_file:= ", "planner_command:=popf a:=b"])
def test_what_roslaunch_would_drop_is_refused(word: str) -> None:
    with pytest.raises(LaunchError, match=f"{word}.*roslaunch drops"):
        LaunchRequest.from_command_line(["merlin", "application.launch", word])


def test_an_empty_argument_is_taken_where_that_is_the_default() -> None:
    request = LaunchRequest.from_command_line(["merlin", "application.launch", "planner_command:="])
    assert request.arguments == {"planner_command": ""}


@pytest.mark.parametrize("file", FILES)
def test_without_a_state_file_nothing_is_kept(file: str) -> None:
    config = load(file, **FILES[file], state_file="none")
    kept = [
        each.value for name, each in config.params.items() if name.endswith(("/state_file", "/goals_file"))
    ]
    assert kept and set(kept) == {""}


@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        ({"on": "serverz"}, "on:=serverz is none of simulator, robot, servers"),
        ({"robots": "ria,tom,tom"}, "robots:=tom,tom names tom twice"),
        ({"robots": "[ria, ria]"}, "robots:=.*ria.* names ria twice"),
        ({"arm": "no"}, "arm:=no is neither true nor false"),
    ],
)
@pytest.mark.parametrize("file", ["application.launch", "robots.launch"])
def test_a_wrong_word_is_named_with_its_argument(file: str, wrong: dict, why: str) -> None:
    points = {"points_of_interest": ROBOT["points_of_interest"]} if file == "robots.launch" else {}
    with pytest.raises(RLException, match=why):
        load(f"include/{file}", **points, **wrong)


@pytest.mark.parametrize(
    ("file", "arguments", "names"),
    [
        ("home.launch", {}, ("explain", "voice_questions")),
        ("restaurant.launch", {}, ("explain", "voice_questions")),
        ("include/robot.launch", ROBOT, ("explain", "voice_questions")),
        ("include/application.launch", {"robots": "ria,tom"}, ("listen", "recognition")),
    ],
)
@pytest.mark.parametrize("wrong", [0, 1])
def test_a_text_is_not_taken_for_true(file: str, arguments: dict, names: tuple, wrong: int) -> None:
    with pytest.raises(RLException, match="{}:= and {}:= are true or false".format(*names)):
        load(file, **arguments, **{names[wrong]: "off"})


@pytest.mark.parametrize(
    ("file", "wrong", "why"),
    [
        ("include/guard.launch", {"simulated": "no"}, "simulated:=no is neither true nor false"),
        ("home.launch", {"approach": "naiv"}, "approach:=naiv is neither merlin nor naive"),
    ],
)
def test_what_would_begin_another_robot_is_refused(file: str, wrong: dict, why: str) -> None:
    with pytest.raises(RLException, match=why):
        load(file, **wrong)


def test_a_bag_in_a_folder_with_a_blank_is_replayed(tmp_path: Path) -> None:
    folder = tmp_path / "my own"
    folder.mkdir()
    (folder / "parameters.yaml").write_text("{}")
    (player,) = [node for node in load("include/replay.launch", folder=folder).nodes if node.type == "play"]
    assert shlex.split(player.args)[-1] == str(folder / "replay.bag")


def test_the_launch_files_leave_limits_as_they_are_documented() -> None:
    for robots, host in (("", "/merlin_fsm_host"), ("ann,bob", "/bob/merlin_fsm_host")):
        config = load("include/robot.launch", **ROBOT, robots=robots)
        assert config.params[f"{host}/cancel_limit"].value == CANCEL_LIMIT
    evening = load("restaurant.launch").params["/mission/startup_timeout"]
    assert evening.value == RecordedEvening.startup_timeout


def test_a_file_that_includes_itself_is_named_on_a_line_that_can_be_read(tmp_path: Path) -> None:
    file = tmp_path / "a.launch"
    file.write_text("<launch><include file='$(dirname)/a.launch'/></launch>")
    with pytest.raises(LaunchError, match="while processing .*maximum recursion depth") as caught:
        LaunchConfig(LaunchRequest.from_command_line([str(file)]))
    assert len(str(caught.value)) < 1100


def test_a_package_path_without_merlin_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_PACKAGE_PATH", "/nowhere")
    with pytest.raises(LaunchError, match="something has changed ROS_PACKAGE_PATH"):
        LaunchRequest.from_command_line(["home.launch"])


def test_a_launch_file_is_found_in_its_package() -> None:
    request = LaunchRequest.from_command_line(["merlin", "monitor.launch", "history:=none"])
    assert request.launch_file.name == "monitor.launch" and request.arguments == {"history": "none"}


def test_a_path_counts_from_the_callers_folder_and_home(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", "/home/ann")
    for name in ("d.pddl", "run"):
        (tmp_path / name).touch()
    words = ["domain_path:=d.pddl", "problem_path:=new.pddl", "results:=~/bags", "state_file:=run"]
    given = LaunchRequest.from_command_line(["merlin", "application.launch", *words]).arguments
    assert given == {
        "domain_path": str(tmp_path / "d.pddl"),
        "problem_path": "new.pddl",
        "results": "/home/ann/bags",
        "state_file": "run",  # a word, also where a file has this name
    }


def test_arguments_of_a_file_that_takes_all_of_them_are_known(tmp_path: Path) -> None:
    for name, text in (
        ("top", '<arg name="on"/><include file="$(dirname)/middle.launch" pass_all_args="true"/>'),
        (
            "middle",
            '<arg name="port" default="1"/><arg name="rate" default="1"/>'
            '<include file="$(dirname)/low.launch"/>',
        ),
        ("low", '<arg name="deep" default="2"/>'),
    ):
        (tmp_path / f"{name}.launch").write_text(f"<launch>{text}</launch>")
    top = str(tmp_path / "top.launch")
    request = LaunchRequest.from_command_line([top, "on:=robot", "port:=7"])
    assert request.arguments == {"on": "robot", "port": "7"} and request.port is None
    with pytest.raises(LaunchError, match="has no argument 'deep'"):
        LaunchRequest.from_command_line([top, "on:=robot", "deep:=7"])
    with pytest.raises(LaunchError, match="needs on:="):
        LaunchRequest.from_command_line([top])
    sets = '<arg name="rate" value="3"/>'
    text = f'<arg name="on"/><include file="$(dirname)/middle.launch" pass_all_args="true">{sets}</include>'
    (tmp_path / "top.launch").write_text(f"<launch>{text}</launch>")
    with pytest.raises(LaunchError, match="has no argument 'rate'"):  # it would count for nothing
        LaunchRequest.from_command_line([top, "on:=robot", "rate:=7"])


@pytest.mark.parametrize(
    "own",
    [
        '<arg name="file" value="low"/>',
        '<arg name="kind" value="low"/><arg name="file" default="$(arg kind)"/>',
        '<arg name="real" default="false"/>'
        "<arg name=\"file\" value=\"$(eval 'high' if arg('real') else 'low')\"/>",
        '<arg name="real" default="false"/><arg if="$(arg real)" name="file" value="high"/>'
        '<arg unless="$(arg real)" name="file" value="low"/>',
    ],
)
def test_a_file_that_is_chosen_by_arguments_is_known(own: str, tmp_path: Path) -> None:
    (tmp_path / "low.launch").write_text('<launch><arg name="rate" default="1"/></launch>')
    top = tmp_path / "top.launch"
    inner = '<include file="$(dirname)/$(arg file).launch" pass_all_args="true"/>'
    top.write_text(f"<launch>{own}{inner}</launch>")
    assert LaunchRequest.from_command_line([str(top), "rate:=2"]).arguments == {"rate": "2"}
    with pytest.raises(LaunchError, match="has no argument 'speed'"):
        LaunchRequest.from_command_line([str(top), "speed:=2"])


def test_a_file_of_parameters_that_is_not_utf8_is_named(tmp_path: Path) -> None:
    world = tmp_path / "world.yaml"
    world.write_bytes("name: Küche".encode("latin-1"))
    request = LaunchRequest.from_command_line(["home.launch", f"world_file:={world}"])
    with pytest.raises(LaunchError, match=f"{world} is not UTF-8 text: invalid "):
        LaunchConfig(request)

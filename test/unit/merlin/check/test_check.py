# SPDX-License-Identifier: Apache-2.0
"""`rosrun merlin check`: what is said of the applications that come with MERLIN, and of a wrong one."""

import os
import shutil
import subprocess
from pathlib import Path
from typing import Any, List

import pytest

from merlin.new.application import new_application
from merlin.new.package_writer import write_application
from merlin_test.node_path import node_path

pytestmark = pytest.mark.processes

APPLICATION = """<launch>
  <include file="$(find merlin)/launch/include/application.launch">
    <arg name="on" value="{on}"/>
    <arg name="domain_path" value="$(find merlin)/pddl/home/domain.pddl"/>
    <arg name="problem_path" value="$(find merlin)/pddl/home/problem.pddl"/>
    <arg name="world_file" value="{points}"/>
    <arg name="actions" value="[{actions}]"/>
  </include>
</launch>
"""
WORLD = """name: square
starts: [{x: 2.0, y: 2.0, yaw: 0.0}]
walls:
- {from: [0, 0], to: [4, 0]}
- {from: [4, 0], to: [4, 4]}
- {from: [4, 4], to: [0, 4]}
- {from: [0, 4], to: [0, 0]}
"""
NAVIGATE, ASK = "merlin_actions.actions.navigate:Navigate", "merlin_home.actions.ask:Ask"


ORDERS = """from merlin_actions.merlin_action_sm import MerlinActionSM


class TakeOrder(MerlinActionSM):
    parameters = ["t"]

    def build(self):
        ask = self.state("ask", "What for {t}?", "#JSGF V1.0; grammar g; public <a> = a tea;")
        self.add("ASK", ask, {"misunderstood": "aborted"})
"""


TALKS = """from merlin_actions.merlin_action_sm import MerlinActionSM


class Drive(MerlinActionSM):
    parameters = ["from", "to"]

    def build(self):
        hear = self.state("ask", "Here?", "#JSGF V1.0; grammar g; public <a> = yes;")
        self.add("HEAR", hear, {"misunderstood": "aborted"})
"""


FETCHES = """from merlin_actions.merlin_action_sm import MerlinActionSM


class TakeOrder(MerlinActionSM):
    parameters = ["t"]

    def build(self):
        self.add("PICK", self.state("pick", "{t}"))
"""


def command(tmp_path: Path, *words: str) -> "subprocess.CompletedProcess[str]":
    """The command in a process of its own; `check` says the same in a tenth of the time."""
    env = {**os.environ, "ROS_LOG_DIR": str(tmp_path), "ROS_HOME": str(tmp_path)}
    return subprocess.run(
        [node_path("merlin", "check"), *words],
        env=env,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )


def application(tmp_path: Path, actions: str, on: str = "simulator", points: str = "kitchen") -> str:
    world = tmp_path / "points.yaml"
    listed = "".join(f"  {name}: {{x: 1.0, y: 1.0, yaw: 0.0}}\n" for name in points.split())
    world.write_text(f"{WORLD}points_of_interest:\n{listed}")
    file = tmp_path / "my.launch"
    file.write_text(APPLICATION.format(on=on, points=world, actions=actions))
    return str(file)


@pytest.mark.parametrize("words", [["restaurant.launch"], ["restaurant.launch", "robots:=robot_1,robot_2"]])
def test_the_applications_of_merlin_fit(check: Any, tmp_path: Path, words: List[str]) -> None:
    done = check(tmp_path, *words)
    assert done.returncode == 0, done.stderr
    assert "points of interest fit; servers: " in done.stdout


def test_the_command_says_that_an_application_fits(tmp_path: Path) -> None:
    done = command(tmp_path, "home.launch")
    assert done.returncode == 0, done.stderr
    assert "points of interest fit; servers: " in done.stdout


@pytest.mark.parametrize(
    ("robots", "said"),
    [
        ("ann,bob", ""),
        ("[ann, kitchen]", "is of type place, not robot"),
        ("ann,2", "robot 2 is not an object of the problem"),
        ("2", "robot 2 is not an object of the problem"),
        ("", "needs (available ?r) of its robot, and no robot is named: start it with robots:=ann,bob"),
    ],
)
def test_robots_are_checked(check: Any, tmp_path: Path, robots: str, said: str) -> None:
    pddl = Path(__file__).resolve().parents[4] / "pddl" / "robots"
    words = [f"domain_path:={pddl}/domain.pddl", f"problem_path:={pddl}/problem.pddl"]
    drive = "actions:=['merlin_actions.actions.drive:Drive']"
    launch = str(pddl.parents[1] / "launch" / "include" / "application.launch")
    done = check(tmp_path, launch, "on:=servers", f"robots:={robots}", drive, *words)
    assert done.returncode == (2 if said else 0), done.stderr
    assert said in done.stderr and "Traceback" not in done.stderr
    if not said:
        assert "robot bob: 1 operators, 1 classes" in done.stdout
        assert "0 classes" not in done.stdout  # of the host of all, which has nothing here


def test_what_does_not_fit_on_one_robot_has_its_name_and_what_robots_hear_is_checked(
    check: Any, tmp_path: Path
) -> None:
    file = tmp_path / "talks.py"
    file.write_text(TALKS)
    pddl = Path(__file__).resolve().parents[4] / "pddl" / "robots"
    launch = str(pddl.parents[1] / "launch" / "include" / "application.launch")
    words = [f"domain_path:={pddl}/domain.pddl", f"problem_path:={pddl}/problem.pddl", "on:=servers"]
    words += [launch, "robots:=ann,bob", "actions:=['talks:Drive']"]
    done = check(tmp_path, *words)
    assert done.returncode == 2
    assert "application.launch: robot ann and bob: state HEAR/LISTEN of Drive uses" in done.stderr
    assert len(done.stderr.splitlines()) == 1
    done = check(tmp_path, *words, "answers:={ann: [yes]}")
    assert done.returncode == 0, done.stderr
    for wrong, said in (
        ("{ann: [yes], tim: [no]}", "answers names tim; the robots of robots:=… are ann, bob"),
        ("{ann: [1]}", "answers has to be a list of texts"),
        ("5", "answers has to be a list with one value or more, not 5"),
    ):
        done = check(tmp_path, *words, f"answers:={wrong}")
        assert done.returncode == 2 and said in done.stderr and len(done.stderr.splitlines()) == 1


def test_a_server_that_a_node_of_another_package_may_be_is_no_mistake(check: Any, tmp_path: Path) -> None:
    domain = "(define (domain d) (:types cup) (:predicates (had ?t - cup)) "
    domain += "(:action take_order :parameters (?t - cup) :effect (had ?t)))"
    (tmp_path / "domain.pddl").write_text(domain)
    (tmp_path / "problem.pddl").write_text("(define (problem p) (:domain d) (:objects mug - cup) (:init))")
    (tmp_path / "fetches.py").write_text(FETCHES)
    file = Path(application(tmp_path, "'fetches:TakeOrder'"))
    text = file.read_text().replace("$(find merlin)/pddl/home", str(tmp_path))
    own = """<node name="gripper" pkg="actionlib_tutorials" type="arm.py"/>
      <node name="mission" pkg="merlin_executor" type="mission" args="mission:=waits:Waits"/></launch>"""
    (tmp_path / "waits.py").write_text(
        "from merlin_executor.mission import GoalDispatcher\n\n\nclass Waits(GoalDispatcher):\n"
        "    servers = ('pick',)\n\n    def run(self):\n        self.achieve('(had mug)')\n"
    )
    file.write_text(text.replace("</launch>", own))
    done = check(tmp_path, str(file))
    assert done.returncode == 0, done.stderr
    for use in ("state PICK of TakeOrder uses the action server 'pick'", "waits:Waits waits for the action"):
        assert f"not looked at: {use}" in done.stdout.replace("node /mission: ", "")
    assert done.stdout.count("/gripper has to serve") == 2
    file.write_text(text.replace("</launch>", own.partition("\n")[2]))
    done = check(tmp_path, str(file))
    assert done.returncode == 2
    assert done.stderr.count("which the launch file does not start") == 2, done.stderr


def test_an_expression_that_fails_is_one_line(tmp_path: Path) -> None:
    file = tmp_path / "my.launch"
    file.write_text("""<launch><arg name="n" default="5"/><group if="$(eval arg('n').strip())"/></launch>""")
    done = command(tmp_path, str(file))
    assert done.returncode == 2
    assert done.stderr == "merlin check: 'int' object has no attribute 'strip'\n"


def test_what_servers_see_is_a_list(check: Any, tmp_path: Path) -> None:
    done = check(tmp_path, "merlin", "application.launch", "on:=servers", "sees:=7")
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1 and "sees has to be" in done.stderr


def test_a_port_of_the_page_that_is_none_is_named(check: Any, tmp_path: Path) -> None:
    for port, read in (("abc", "'abc'"), ("65536", "65536")):
        done = check(tmp_path, "home.launch", f"monitor_port:={port}")
        assert f"port is {read}, not a whole number from 0 to 65535" in done.stderr
        assert done.returncode == 2


def test_panels_that_are_no_list_are_one_mistake(check: Any, tmp_path: Path) -> None:
    done = check(tmp_path, "merlin", "application.launch", "panels:=my_robot.battery:Battery")
    said = "~panels is 'my_robot.battery:Battery'; give [package.module:Class, …]"
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1 and said in done.stderr


@pytest.mark.parametrize("points", ["5", "[1, 2]"])
def test_points_of_interest_that_are_no_map_are_named(check: Any, tmp_path: Path, points: str) -> None:
    file = tmp_path / "guide" / "guide.launch"
    shutil.copytree(Path(__file__).parent / "guide", file.parent)
    end = f'<rosparam param="world/points_of_interest">{points}</rosparam></launch>'
    file.write_text(file.read_text().replace("</launch>", end))
    done = check(file.parent, str(file))
    assert done.returncode == 2
    assert f"world/points_of_interest is {points}; write name" in done.stderr


def test_a_robot_for_which_the_world_has_no_start_is_named(check: Any, tmp_path: Path) -> None:
    world = tmp_path / "world.yaml"
    world.write_text(f"{WORLD}points_of_interest: {{}}\n")
    for robots, said in (("ann", ""), ("ann,bob", "no start left for robot 'bob'; world square has 1")):
        done = check(tmp_path, "merlin", "application.launch", f"robots:={robots}", f"world_file:={world}")
        assert said in done.stderr and ("no start left" in done.stderr) == bool(said)


def test_every_mistake_of_an_application_is_named(check: Any, tmp_path: Path) -> None:
    done = check(tmp_path, application(tmp_path, NAVIGATE, points="kitchen bathroom dorm_room"))
    assert done.returncode == 2
    missing, operator = done.stderr.splitlines()
    assert missing.startswith("my.launch: object main_door of the problem is not a point of interest")
    assert operator.startswith("my.launch: operator ask of the domain has no class")


@pytest.mark.everywhere
def test_a_misspelt_class_is_named(tmp_path: Path) -> None:
    done = command(tmp_path, application(tmp_path, f"{NAVIGATE}, {ASK}k"))
    assert done.returncode == 2
    assert "merlin_home.actions.ask has no Askk" in done.stderr and "Traceback" not in done.stderr


def test_a_mission_that_does_not_exist_and_an_object_declared_twice_are_named(
    check: Any, tmp_path: Path
) -> None:
    launch = Path(application(tmp_path, f"{NAVIGATE}, {ASK}", points="kitchen bathroom dorm_room main_door"))
    home = Path(__file__).resolve().parents[4] / "pddl" / "home" / "problem.pddl"
    problem = tmp_path / "problem.pddl"
    problem.write_text(home.read_text().replace("kitchen", "kitchen kitchen", 1))
    args = "mission:=merlin_home.home_mission:X"
    node = f'<node pkg="merlin_executor" type="mission" name="mission" args="{args}"/>'
    text = launch.read_text().replace("$(find merlin)/pddl/home/problem.pddl", str(problem))
    launch.write_text(text.replace("</launch>", f"{node}</launch>"))
    done = check(tmp_path, str(launch))
    assert done.returncode == 2
    assert "node /mission: 'merlin_home.home_mission:X': module" in done.stderr and "has no X" in done.stderr
    assert "warning: 'kitchen' is declared in line" in done.stdout


def test_a_misspelt_supertype_is_named(check: Any, tmp_path: Path) -> None:
    launch = Path(application(tmp_path, f"{NAVIGATE}, {ASK}", points="kitchen bathroom dorm_room main_door"))
    home = Path(__file__).resolve().parents[4] / "pddl" / "home" / "domain.pddl"
    domain = tmp_path / "domain.pddl"
    domain.write_text(home.read_text().replace("(:types", "(:types cellar - plase", 1))
    launch.write_text(launch.read_text().replace("$(find merlin)/pddl/home/domain.pddl", str(domain)))
    assert (
        "warning: the type 'plase' is declared nowhere (did you mean 'place'?)"
        in check(tmp_path, str(launch)).stdout
    )


def test_an_effect_that_needs_an_open_duration_is_named(check: Any, tmp_path: Path) -> None:
    launch = Path(application(tmp_path, f"{NAVIGATE}, {ASK}", points="kitchen bathroom dorm_room main_door"))
    home = Path(__file__).resolve().parents[4] / "pddl" / "home" / "domain.pddl"
    domain = tmp_path / "domain.pddl"
    text = home.read_text()
    text = text.replace("(= ?duration (travel_time ?from ?to))", "(>= ?duration (travel_time ?from ?to))")
    text = text.replace(":effect (and", ":effect (and (at start (increase (spent) ?duration))", 1)
    domain.write_text(text.replace("(:functions", "(:functions (spent)", 1))
    launch.write_text(launch.read_text().replace("$(find merlin)/pddl/home/domain.pddl", str(domain)))
    done = check(tmp_path, str(launch))
    assert done.returncode == 2
    assert "cannot start: its effect on spent: ?duration is not known" in done.stderr


def test_a_constraint_whose_times_the_dispatch_does_not_keep_is_named(check: Any, tmp_path: Path) -> None:
    launch = Path(application(tmp_path, f"{NAVIGATE}, {ASK}", points="kitchen bathroom dorm_room main_door"))
    home = Path(__file__).resolve().parents[4] / "pddl" / "home" / "domain.pddl"
    domain = tmp_path / "domain.pddl"
    within = "(forall (?p - place) (preference soon (within 600 (robot_at ?p))))"
    constraints = f"(:constraints (and {within} (sometime (robot_at main_door))))"
    domain.write_text(home.read_text().replace("(:functions", f"{constraints}\n(:functions", 1))
    launch.write_text(launch.read_text().replace("$(find merlin)/pddl/home/domain.pddl", str(domain)))
    said = [line for line in check(tmp_path, str(launch)).stdout.splitlines() if "warning" in line]
    assert [line.split("warning: ")[1] for line in said] == [
        "(within 600 (robot_at ?p)): a plan keeps its times as far as actions last as planned; the "
        "dispatch does not"
    ]


def test_a_mission_that_does_not_make_its_base_is_named(check: Any, tmp_path: Path) -> None:
    launch = Path(application(tmp_path, f"{NAVIGATE}, {ASK}", points="kitchen bathroom dorm_room main_door"))
    node = '<node pkg="merlin_executor" type="mission" name="mission" args="mission:=KIND"/>'
    own = launch.read_text().replace("</launch>", f"{node}</launch>")
    (tmp_path / "bare.py").write_text(
        "from merlin_executor.mission import GoalDispatcher\n\n\n"
        "class Made(GoalDispatcher):\n"
        "    def __init__(self, rooms: int = 1):\n        super().__init__('made', rooms)\n\n"
        "    def run(self):\n        pass\n\n\n"
        "class Bare(Made):\n    def __init__(self, rooms: int = 1):\n        self.rooms = rooms\n\n\n"
        "class Heir(Made):\n    pass\n"
    )
    for kind, wrong in (("Made", False), ("Bare", True), ("Heir", False)):
        launch.write_text(own.replace("KIND", f"bare:{kind}"))
        done = check(tmp_path, str(launch))
        said = f"node /mission: bare:{kind} cannot be made: its __init__ does not call super().__init__()"
        assert (done.returncode, said in done.stderr) == (2 if wrong else 0, wrong), done.stderr


def test_a_day_is_checked_with_its_goals(check: Any, tmp_path: Path) -> None:
    launch = Path(application(tmp_path, f"{NAVIGATE}, {ASK}", points="kitchen bathroom dorm_room main_door"))
    day = tmp_path / "day.yaml"
    day.write_text("- every: 20min\n  goals: (checked moon)\n")
    args = "mission:=merlin_executor.mission:Day"
    node = f"""<node pkg="merlin_executor" type="mission" name="mission" args="{args}">
      <param name="file" value="{day}"/></node>"""
    launch.write_text(launch.read_text().replace("</launch>", f"{node}</launch>"))
    done = check(tmp_path, str(launch))
    assert done.returncode == 2
    assert f"{day}:1: (checked moon): " in done.stderr and "moon" in done.stderr.partition("moon)")[2]
    day.write_text("- every: 20min\n  goals: (checked kitchen)\n  dedline: 5min\n")
    assert f"{day}:1: 'dedline' is none of at, every" in check(tmp_path, str(launch)).stderr


def order_application(tmp_path: Path, on: str, action: str) -> Path:
    domain = tmp_path / "order.pddl"
    domain.write_text("(define (domain order) (:action take_order :parameters (?t - object)))")
    (tmp_path / f"my_orders_{on}.py").write_text(action)
    launch = Path(application(tmp_path, f"my_orders_{on}:TakeOrder", on=on))
    text = launch.read_text().replace("$(find merlin)/pddl/home/domain.pddl", str(domain))
    launch.write_text(text.replace("$(find merlin)/pddl/home/problem.pddl", ""))
    return launch


def test_a_server_that_is_missing_is_named_and_one_with_a_script_is_there(check: Any, tmp_path: Path) -> None:
    launch = order_application(tmp_path, "servers", ORDERS)
    missing = check(tmp_path, str(launch))
    assert missing.returncode == 2
    assert "state ASK/LISTEN of TakeOrder uses the action server 'listen', which the launch" in missing.stderr
    launch.write_text(
        launch.read_text().replace('name="on"', """name="answers" value="['a tea']"/><arg name="on\"""")
    )
    assert check(tmp_path, str(launch)).returncode == 0


def test_a_new_mission_is_told_of_a_server_that_is_missing(check: Any, tmp_path: Path) -> None:
    package = write_application(new_application("my_robot", []), tmp_path / "ws")
    launch = package / "launch" / "my_robot.launch"
    text = launch.read_text().replace("$(find my_robot)", str(package))
    launch.write_text(text)
    fits = check(package / "src", str(launch), "on:=servers")
    assert fits.returncode == 0, fits.stderr
    renamed = '<launch><remap from="sound_play" to="say"/>'
    launch.write_text(text.replace("<launch>", renamed, 1))
    missing = check(package / "src", str(launch), "on:=servers")
    assert missing.returncode == 2
    assert "my_robot.mission:MyRobotMission waits for the action servers sound_play, which" in missing.stderr


def test_an_arm_is_among_the_simulated_servers_and_in_a_simulator_where_it_is_asked_for(
    check: Any, tmp_path: Path
) -> None:
    fits = check(tmp_path, str(order_application(tmp_path, "servers", FETCHES)))
    assert fits.returncode == 0, fits.stderr
    assert "servers: pick" in fits.stdout
    launch = order_application(tmp_path, "simulator", FETCHES)
    missing = check(tmp_path, str(launch))
    assert missing.returncode == 2
    assert "state PICK of TakeOrder uses the action server 'pick', which the launch" in missing.stderr
    launch.write_text(launch.read_text().replace('name="on"', 'name="arm" value="true"/><arg name="on"'))
    assert check(tmp_path, str(launch)).returncode == 0


def test_a_robot_has_to_bring_its_servers(check: Any, tmp_path: Path) -> None:
    points = "kitchen bathroom dorm_room main_door"
    done = check(tmp_path, application(tmp_path, f"{NAVIGATE}, {ASK}", on="robot", points=points))
    assert done.returncode == 0, done.stderr
    assert "servers: move_base, sound_play, which the robot has to serve" in done.stdout
    assert "no node is named 'mission'" in done.stdout

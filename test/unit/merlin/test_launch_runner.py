# SPDX-License-Identifier: Apache-2.0
"""The runner with real processes: how a run ends, what it says, and that nothing of it is left."""

import contextlib
import json
import os
import re
import resource
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Dict, List, Tuple, Union

import pytest

from merlin.launch_config import Loader
from merlin.launch_runner import CHECK
from merlin_test.node_path import LEAN
from merlin_test.process_signals import gone, hang

pytestmark = pytest.mark.processes

LAUNCH_FILE = Path(__file__).resolve().parents[2] / "data" / "runner" / "runner.launch"
APPLICATION = Path(__file__).resolve().parents[3] / "launch" / "include" / "application.launch"
LIMIT = 200.0  # s for a run to end
MAIN = "raise SystemExit(supervision.main())"
RUN = f"{LEAN}from merlin import supervision; {MAIN}"
#: The same, and gives up what has died twice, however slow this machine is.
RUN_TWICE = (
    f"{LEAN}from merlin import launch_runner, supervision; supervision.PAUSES = (0.1, 0.1); "
    f"launch_runner.WRAPPER_SPAN = 300.0; {MAIN}"
)
#: The same, and says when it begins the check beside it, and when it waits for its end.
RUN_TELLS = f"""{LEAN}
import os, subprocess
from merlin import launch_runner, supervision
class Told(subprocess.Popen):
    def __init__(self, command, *more, **options):
        super().__init__(command, *more, **options)
        self.checks = launch_runner.CHECK in command
        os.write(1, b"checks\\n" * self.checks)
    def wait(self, timeout=None):
        os.write(1, b"waits\\n" * self.checks)
        return super().wait(timeout)
subprocess.Popen = Told
{MAIN}
"""
WRAPPED = """<launch>
  <node pkg="merlin_test" type="fake_node.py" name="other" args="{}" required="true"
        launch-prefix="$(find merlin)/scripts/respawn"/>
  <node pkg="merlin_test" type="fake_node.py" name="mission" args="wait"/>
</launch>"""
MISSION = """<launch>
  <node pkg="merlin_test" type="fake_node.py" name="other" args="wait"/>
  <node pkg="merlin_test" type="fake_node.py" name="mission" args="wait" required="true"
        launch-prefix="env RESPAWN_KILLED=only $(find merlin)/scripts/respawn"/>
</launch>"""


#: Hosts begin when there is a knowledge base, which this one never has.
HOST = """<launch>
  <param name="rosplan_knowledge_base/domain_path" value="$(find merlin)/pddl/home/domain.pddl"/>
  <param name="rosplan_knowledge_base/problem_path" value="$(find merlin)/pddl/home/problem.pddl"/>
  <node pkg="merlin_actions" type="simulated_base" name="base"/>
  <node pkg="merlin_actions" type="fsm_host" name="host">
    <rosparam param="actions">[merlin_home.actions.ask:Ask]</rosparam>
    <param name="knowledge_base_wait" value="3600"/>
  </node>
</launch>"""


class Run:
    """One run in a session of its own."""

    def __init__(self, tmp_path: Path, *words: str, code: str = RUN, **variables: str) -> None:
        env = {**os.environ, "ROS_HOME": str(tmp_path), "ROS_LOG_DIR": str(tmp_path / "log"), **variables}
        env.pop("ROS_MASTER_URI", None)
        self._mark = f"MERLIN_TEST={tmp_path}"
        env["MERLIN_TEST"] = str(tmp_path)
        self.process = subprocess.Popen(
            [sys.executable, "-c", code, *words],
            env=env,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def end(self) -> Tuple[int, List[str], List[str]]:
        """Exit code, lines of standard output, lines of standard error."""
        out, err = self.process.communicate(timeout=LIMIT)
        return self.process.returncode, out.splitlines(), err.splitlines()

    def read_until(self, text: str) -> str:
        """Reads standard output up to the line that holds the text."""
        for line in self.process.stdout:
            if text in line:
                return line
        raise AssertionError(f"'{text}' never came: {self.process.communicate()}")

    def left(self) -> List[str]:
        """Command lines of living processes that inherited this run's environment."""
        return list(self.living().values())

    def living(self) -> Dict[int, str]:
        """The same by process."""
        found = {}
        for folder in Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(OSError):  # ended meanwhile
                if self._mark.encode() in (folder / "environ").read_bytes():
                    found[int(folder.name)] = (folder / "cmdline").read_text().replace("\0", " ")
        return found

    def kill_wrapper(self) -> None:
        """Kills the one that runs, as soon as it does.

        A subshell of the script has the same command line, and the runner for its parent when the script was
        killed, but the script's session.
        """
        until, runner = time.monotonic() + LIMIT, self.runner()
        while time.monotonic() < until:
            for process, command in self.living().items():
                found = command.startswith("/bin/sh") and "/respawn" in command
                if found and parent_of(process) == runner and session_of(process) == process:
                    os.kill(process, signal.SIGKILL)
                    return
            time.sleep(0.05)
        raise AssertionError("no wrapper runs")

    def runner(self) -> int:
        """The child that carries out the run."""
        return int(Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text().split()[0])


def parent_of(process: int) -> int:
    """Process id of the parent; 0: the process has ended."""
    with contextlib.suppress(OSError):
        return int(Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[1])
    return 0


def session_of(process: int) -> int:
    """Process id of the leader of the session; 0: the process has ended."""
    with contextlib.suppress(OSError):
        return os.getsid(process)
    return 0


def run(tmp_path: Path, *words: str, **variables: str) -> Tuple[int, List[str], List[str]]:
    started = Run(tmp_path, *words, **variables)
    result = started.end()
    assert started.left() == []
    return result


@pytest.mark.parametrize("code", [0, 3])
def test_ends_with_the_missions_exit_code_and_shows_only_its_lines(tmp_path: Path, code: int) -> None:
    exit_code, out, err = run(tmp_path, str(LAUNCH_FILE), f"mission:=exit {code}")
    assert exit_code == code
    assert out == ["mission: last line"]
    if code:
        assert len(err) == 1
        assert "exit code 3" in err[0]
        assert Path(err[0].rsplit("logs: ", 1)[1]).is_dir()
    else:
        assert err == []


def test_says_what_no_node_says_of_the_application(tmp_path: Path) -> None:
    launch = tmp_path / "host.launch"
    launch.write_text(HOST)
    started = Run(tmp_path, str(launch))
    for line in started.process.stderr:
        if "sound_play" in line:
            break
    assert line.startswith("merlin run: host.launch: state ")
    assert "uses the action server 'sound_play', which the launch file does not start" in line
    started.process.send_signal(signal.SIGINT)
    code, _, _ = started.end()
    assert (code, started.left()) == (130, [])


def test_the_nodes_are_stopped_before_the_check_has_ended(tmp_path: Path) -> None:
    launch = tmp_path / "host.launch"
    mission = '<node pkg="merlin_test" type="fake_node.py" name="mission" args="wait"/></launch>'
    launch.write_text(HOST.replace("</launch>", mission))
    started = Run(tmp_path, str(launch), code=RUN_TELLS)
    said = ""
    while not ("ready" in said and "checks" in said):
        line = started.process.stdout.readline()
        assert line, started.end()
        said += line
    started.process.send_signal(signal.SIGINT)
    code, out, _ = started.end()
    assert code == 130
    assert [line for line in out if line in ("mission: interrupted", "waits")] == [
        "mission: interrupted",
        "waits",
    ]


def test_the_check_beside_a_run_that_was_killed_before_it_began_is_not_made() -> None:
    starter = subprocess.Popen(["true"])
    starter.wait()
    check = [sys.executable, "-c", CHECK, str(starter.pid), "nowhere.launch"]
    done = subprocess.run(check, capture_output=True, text=True, timeout=LIMIT)
    assert (done.returncode, done.stdout, done.stderr) == (128 + signal.SIGKILL, "", "")


#: What cannot be looked for, as a file in the folder of another user cannot.
UNREADABLE = f"/{'x' * 300}"
#: Command lines, or the content of a launch file → what is said.
REFUSED = {
    (): "name a launch file",
    ("nowhere", "x.launch"): "no package 'nowhere'",
    ("merlin", "nowhere.launch"): "package merlin has no files 'nowhere.launch'; its launch files are: act",
    ("nowhere.launch",): "no launch file 'nowhere.launch'",
    (str(LAUNCH_FILE), "misson:=exit 0"): "did you mean 'mission'?",
    (str(LAUNCH_FILE), "port:=eleven"): "not a TCP port",
    (str(LAUNCH_FILE), "port:=²"): "not a TCP port",
    (UNREADABLE,): f"{UNREADABLE} cannot be read: File name too long",
    (str(LAUNCH_FILE), f"domain:={UNREADABLE}"): f"{UNREADABLE} cannot be read: File name too long",
    (str(LAUNCH_FILE), "linger:=maybe"): "not one of false, true, auto",
    (str(LAUNCH_FILE), "domain:=/nowhere/domain.pddl"): "/nowhere/domain.pddl",
    (str(LAUNCH_FILE), "executable:=nothing"): "merlin_test/nothing",
    (str(APPLICATION), "on:=server"): "on:=server is none of simulator, robot, servers",
    "<include file='/nowhere.launch'/>": "/nowhere.launch",
    "<include file='$(find nowhere)/x.launch'/>": "no package 'nowhere'",
    "<arg name='a' value='$(find nowhere)' doc='make it'/>": "no package 'nowhere'; make it",
    "<param if='maybe' name='a' value='1'/>": "maybe",
    "<param name='a'": "XML",
    "<node name='a' pkg='merlin' type='run' args='&quot;b'/>": 'node /a: "b: No closing quotation',
    "<node name='a' pkg='merlin' type='run' launch-prefix='nowhere -x'/>": "to run: nowhere -x",
    "<param if='$(eval a)' name='a' value='1'/>": "name 'a' is not defined",
    "<param name='a' type='int' value='2147483648'/>": "parameter /a has a value that a ROS master cannot",
    "<rosparam>a: {b: 2026-11-30}</rosparam>": "parameter /a/b has a value that a ROS master cannot",
    "<rosparam>a: {on: 1}</rosparam>": "below /a: True is not a text; write the name in quotes",
}  # fmt: skip
#: All of them in one process: one of its own takes seconds to begin.
REFUSE = """
import json, sys
from merlin.launch_runner import main
for words in json.loads(sys.argv.pop()):
    sys.argv[1:] = words
    print("exit code", main(), file=sys.stderr, flush=True)
"""


@pytest.fixture(scope="module")
def refusals(tmp_path_factory: pytest.TempPathFactory) -> Dict[Union[str, tuple], List[str]]:
    """What is said of each, and last its exit code."""
    folder, commands = tmp_path_factory.mktemp("refused"), []
    for number, case in enumerate(REFUSED):
        if isinstance(case, str):
            (folder / f"broken{number}.launch").write_text(f"<launch>{case}</launch>")
            case = (str(folder / f"broken{number}.launch"),)
        commands.append(case)
    started = Run(folder, json.dumps(commands), code=REFUSE)
    code, out, err = started.end()
    assert (code, out, started.left()) == (0, [], [])
    parts = re.split(r"(?<=exit code \d)\n", "\n".join(err))
    assert len(parts) == len(REFUSED), err
    return {case: part.splitlines() for case, part in zip(REFUSED, parts)}


@pytest.mark.parametrize("case", REFUSED, ids=str)
def test_bad_input_is_one_line(refusals: Dict[Union[str, tuple], List[str]], case: Union[str, tuple]) -> None:
    line, code = refusals[case]
    assert code == "exit code 2" and REFUSED[case] in line


@pytest.mark.everywhere
def test_a_busy_port_is_refused(tmp_path: Path) -> None:
    with socket.socket() as holder:
        holder.bind(("", 0))
        holder.listen()
        port = holder.getsockname()[1]
        exit_code, _, err = run(tmp_path, str(LAUNCH_FILE), f"port:={port}")
    assert exit_code == 2
    assert len(err) == 1
    assert str(port) in err[0]


@pytest.mark.everywhere
@pytest.mark.parametrize(("variable", "made"), [("ROS_HOME", ""), ("ROS_LOG_DIR", "/")])
def test_a_folder_of_ros_that_cannot_be_made_is_named(tmp_path: Path, variable: str, made: str) -> None:
    folder = tmp_path / "a file"  # root may write to any folder
    folder.touch()
    code, out, err = run(tmp_path, str(LAUNCH_FILE), "mission:=exit 0", **{variable: f"{folder}/ros"})
    assert (code, out, len(err)) == (2, [], 1)
    assert f"the folder {folder}/ros{made}" in err[0]
    assert "cannot be made: Not a directory; set ROS_HOME, and ROS_LOG_DIR" in err[0]


def test_an_address_of_another_machine_is_named(tmp_path: Path) -> None:
    code, _, err = run(
        tmp_path, str(LAUNCH_FILE), "mission:=exit 0", ROS_IP="127.0.0.1", ROS_HOSTNAME="x.invalid"
    )
    assert (code, len(err)) == (2, 1)
    assert "ROS_HOSTNAME=x.invalid is not an address of this machine, it seems; correct or unset it" in err[0]


@pytest.mark.everywhere
def test_two_runs_beside_each_other(tmp_path: Path) -> None:
    first = Run(tmp_path / "a", str(LAUNCH_FILE), "mission:=wait")
    second = Run(tmp_path / "b", str(LAUNCH_FILE), "mission:=exit 0")
    assert second.end()[0] == 0
    first.read_until("ready")
    first.process.send_signal(signal.SIGTERM)
    assert first.end()[0] == 143
    assert first.left() == second.left() == []


@pytest.mark.everywhere
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_stops_everything(tmp_path: Path, number: int, code: int) -> None:
    started = Run(tmp_path, str(LAUNCH_FILE), "mission:=wait")
    started.read_until("ready")
    started.process.send_signal(number)
    exit_code, _, err = started.end()
    assert exit_code == code
    assert "stopping" in err[0]
    assert started.left() == []


def computed() -> float:
    """s of processor time of the processes that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def test_a_node_that_ignores_signals_is_killed_and_waiting_for_it_costs_nothing(tmp_path: Path) -> None:
    started = Run(tmp_path, str(LAUNCH_FILE), "mission:=deaf", "other:=deaf")
    started.read_until("ready")
    begun, before = time.monotonic(), computed()
    started.process.send_signal(signal.SIGINT)
    assert started.end()[0] == 130
    assert started.left() == []
    # A thread that looks at a closed socket would take a whole processor.
    assert computed() - before < (time.monotonic() - begun) / 2


def test_what_a_node_leaves_behind_is_ended(tmp_path: Path) -> None:
    exit_code, out, _ = run(tmp_path, str(LAUNCH_FILE), "mission:=litter")
    assert exit_code == 0
    (child,) = re.findall(r"left (\d+) behind", "\n".join(out))  # that one may say first that it is ready
    assert not Path(f"/proc/{child}").exists()


def test_a_required_node_that_dies_ends_the_run_by_name(tmp_path: Path) -> None:
    exit_code, _, err = run(tmp_path, str(LAUNCH_FILE), "mission:=wait", "other:=exit 4", "required:=true")
    assert exit_code == 4, err
    assert "node 'other' died with exit code 4" in err[0]


def test_a_required_node_that_dies_while_others_are_started_is_named(tmp_path: Path) -> None:
    others = "".join(
        f'<node pkg="merlin_test" type="fake_node.py" name="other_{number}" launch-prefix="/bin/true"/>'
        for number in range(100)
    )
    first = '<node pkg="merlin_test" type="fake_node.py" name="first" args="exit 4" required="true"/>'
    (tmp_path / "many.launch").write_text(f"<launch>{first}{others}</launch>")
    exit_code, _, err = run(tmp_path, str(tmp_path / "many.launch"))
    assert exit_code == 4, err
    assert "required node 'first' died with exit code 4" in err[-1]


def test_another_node_that_dies_is_only_reported(tmp_path: Path) -> None:
    started = Run(tmp_path, str(LAUNCH_FILE), "mission:=wait", "other:=exit 4")
    started.read_until("ready")
    assert "node 'other' died" in started.process.stderr.readline()
    started.process.send_signal(signal.SIGINT)
    assert started.end()[0] == 130


def wrapped(tmp_path: Path, what: str, code: str = RUN) -> Run:
    (tmp_path / "wrapped.launch").write_text(WRAPPED.format(what))
    return Run(tmp_path, str(tmp_path / "wrapped.launch"), code=code)


def test_a_wrapper_that_is_killed_is_started_again_until_it_was_too_often(tmp_path: Path) -> None:
    started = wrapped(tmp_path, "wait", RUN_TWICE)
    started.read_until("ready")
    for count in (1, 2):
        started.kill_wrapper()
        assert started.process.stderr.readline() == (
            "merlin run: the wrapper of node 'other' was killed (SIGKILL); it is started again, "
            f"{count} of 2 times within 300 s\n"
        )
    started.kill_wrapper()
    code, _, err = started.end()
    assert code == 137
    assert "for the 3th time within 300 s; it is not started again" in err[0]
    assert "required node 'other' died" in err[1]
    assert started.left() == []


def test_a_wrapped_node_that_cannot_begin_ends_the_run(tmp_path: Path) -> None:
    started = wrapped(tmp_path, "exit 2")
    code, _, err = started.end()
    assert (code, started.left()) == (2, [])
    assert "required node 'other' died with exit code 2" in err[0]


def test_a_mission_that_is_killed_ends_nothing_of_the_run(tmp_path: Path) -> None:
    (tmp_path / "mission.launch").write_text(MISSION)
    started = Run(tmp_path, str(tmp_path / "mission.launch"))
    mission = int(started.read_until("ready").split()[-1])
    (other,) = (pid for pid, line in started.living().items() if "__name:=other" in line)
    os.kill(mission, signal.SIGKILL)
    assert any("mission died (signal KILL); it is started" in line for line in started.process.stderr)
    again = int(started.read_until("ready").split()[-1])
    assert again != mission and other in started.living()
    started.kill_wrapper()
    assert any("the wrapper of node 'mission' was killed" in line for line in started.process.stderr)
    last = int(started.read_until("ready").split()[-1])
    assert other in started.living()
    os.kill(last, signal.SIGINT)  # it ends by itself
    assert started.end()[0] == 0 and started.left() == []


def test_a_run_that_is_killed_is_started_again(tmp_path: Path) -> None:
    started = wrapped(tmp_path, "wait")
    for _ in range(2):
        started.read_until("ready")
        before = set(started.living()) - {started.process.pid}
        os.kill(started.runner(), signal.SIGKILL)
        assert "the run was killed (SIGKILL), its nodes are ended" in started.process.stderr.readline()
    started.read_until("ready")
    assert not before & set(started.living())
    started.process.send_signal(signal.SIGTERM)
    code, _, err = started.end()
    assert code == 143
    assert "SIGTERM: stopping" in err[0]
    assert started.left() == []


def test_a_run_ends_in_order_when_its_supervisor_is_killed(tmp_path: Path) -> None:
    started = wrapped(tmp_path, "wait")
    started.read_until("ready")
    started.process.kill()
    _, _, err = started.end()  # the run holds the pipes until it has ended
    assert "SIGTERM: stopping" in err[0]
    assert started.left() == []


def test_nodes_end_in_order_when_run_and_supervisor_are_killed_together(tmp_path: Path) -> None:
    started = wrapped(tmp_path, "wait")
    started.read_until("ready")
    killed = (started.process.pid, started.runner())
    for process in killed:
        hang(process)  # neither sees the end of the other
    nodes = set(started.living()) - set(killed)
    for process in killed:
        os.kill(process, signal.SIGKILL)
    try:
        assert all(gone(node) for node in nodes)
        assert "mission: interrupted" in started.end()[1]
    finally:
        for process in started.living():
            os.kill(process, signal.SIGKILL)


def test_the_version_of_ros_is_what_its_command_says() -> None:
    for command in ("rosversion roslaunch", "rosversion -d"):
        said = subprocess.run(command.split(), stdout=subprocess.PIPE, text=True, check=True).stdout
        assert Loader().param_value(False, "version", "str", None, None, None, command) == said


def test_rosrun_finds_one_executable_only() -> None:
    # With two it asks catkin twice more, 0.1 s each, which of them is meant.
    from roslib.packages import find_node

    assert len(find_node("merlin", "run")) == 1

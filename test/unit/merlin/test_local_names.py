# SPDX-License-Identifier: Apache-2.0
"""Where the machine's name, or localhost, has no address, what runs on one machine runs on 127.0.0.1."""

import os
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any, Dict, List

import pytest

from merlin import local_names
from merlin_test import LONG
from merlin_test.ports import free_ports

pytestmark = pytest.mark.processes

TOOLS = Path(__file__).resolve().parents[3] / "tools"
RUN = "from merlin.launch_runner import main; raise SystemExit(main())"
TOOL = "from merlin.local_names import *; import os; use_loopback(); tool = launch_tool('roslaunch'); "

NODE = """
import sys
import rospy
from std_msgs.msg import String

rospy.init_node("node")
if "talks" in sys.argv:
    talker = rospy.Publisher("word", String, latch=True, queue_size=1)
    talker.publish("hello")
    rospy.spin()
else:
    print("heard", rospy.wait_for_message("word", String).data, flush=True)
"""
LAUNCH = """
<launch>
  <node pkg="merlin_test" type="fake_node.py" name="other" launch-prefix="{python} {node}" args="talks"/>
  <node pkg="merlin_test" type="fake_node.py" name="mission" launch-prefix="{python} {node}" args="listens"
        required="true" output="screen"/>
</launch>
"""


def without(names: List[str], tmp_path: Path, *command: str) -> "subprocess.CompletedProcess[str]":
    """Runs a command that finds no address of some names; skips the test where that is not allowed."""
    lines = Path("/etc/hosts").read_text(encoding="utf-8").splitlines()
    kept = [line for line in lines if not set(line.split("#")[0].split()) & set(names)]
    hosts, servers, switch = (tmp_path / name for name in ("hosts", "resolv.conf", "nsswitch.conf"))
    hosts.write_text("\n".join([*kept, "127.0.0.1 another", ""]), encoding="utf-8")
    servers.write_text("", encoding="utf-8")
    switch.write_text("hosts: files\n", encoding="utf-8")
    mounts = [
        f"mount --bind {file} /etc/{file.name}"
        for file in (hosts, servers, switch)
        if (Path("/etc") / file.name).exists()
    ]
    space = ["unshare", "-m", "bash", "-c", " && ".join([*mounts, 'exec "$@"']), "bash"]
    try:
        allowed = subprocess.run([*space, "true"], capture_output=True, text=True, timeout=LONG, check=False)
    except FileNotFoundError:
        pytest.skip("there is no unshare")
    if allowed.returncode:
        pytest.skip(f"a file system of the test's own is refused: {allowed.stderr.strip()}")
    env: Dict[str, str] = {**os.environ, "ROS_HOME": str(tmp_path), "ROS_LOG_DIR": str(tmp_path / "log")}
    for key in ("ROS_IP", "ROS_HOSTNAME", "ROS_MASTER_URI"):
        env.pop(key, None)
    return subprocess.run(
        [*space, *command], env=env, capture_output=True, text=True, timeout=LONG, check=False
    )


@pytest.fixture
def launch_file(tmp_path: Path) -> str:
    """Two nodes, of which one hears the other."""
    node, file = tmp_path / "node.py", tmp_path / "pair.launch"
    node.write_text(NODE, encoding="utf-8")
    file.write_text(LAUNCH.format(python=sys.executable, node=node), encoding="utf-8")
    return str(file)


def test_a_run_does_not_need_the_names_of_its_machine(tmp_path: Path, launch_file: str) -> None:
    name = socket.gethostname()
    done = without([name, "localhost"], tmp_path, sys.executable, "-c", RUN, launch_file)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "heard hello" in done.stdout
    assert f"'localhost' and '{name}' cannot be resolved, 127.0.0.1 is used" in done.stderr
    assert f"'127.0.0.1 localhost', and the line '127.0.1.1 {name}' in /etc/hosts" in done.stderr


def test_roslaunch_below_a_test_does_not_need_them(tmp_path: Path, launch_file: str) -> None:
    code = TOOL + "os.environ['ROS_MASTER_URI'] = master_uri(0).replace(':0', ':' + sys.argv[1]); "
    code += "os.execvp(tool[0], [*tool, '-p', sys.argv[1], sys.argv[2]])"
    (port,) = free_ports(1)
    name = socket.gethostname()
    done = without([name, "localhost"], tmp_path, sys.executable, "-c", code, str(port), launch_file)
    assert "heard hello" in done.stdout, done.stdout + done.stderr


@pytest.mark.everywhere
def test_the_tools_of_the_workspace_do_not_need_them(tmp_path: Path) -> None:
    name = socket.gethostname()
    shell = ["sh", "-c", "echo $ROS_IP $ROS_MASTER_URI"]
    done = without([name, "localhost"], tmp_path, str(TOOLS / "in_workspace.sh"), *shell)
    assert done.stdout.split() == ["127.0.0.1", "http://127.0.0.1:11311"], done.stderr
    assert f"'127.0.1.1 {name}' in /etc/hosts" in done.stderr
    given = ["env", "ROS_MASTER_URI=http://localhost:11999", str(TOOLS / "in_workspace.sh"), *shell]
    assert without([name, "localhost"], tmp_path, *given).stdout.split()[-1] == "http://127.0.0.1:11999"


@pytest.fixture
def unknown(monkeypatch: pytest.MonkeyPatch) -> Any:
    """No name has an address, and the user has set nothing."""

    def fail(name: str, port: Any) -> None:
        raise socket.gaierror(name)

    monkeypatch.setattr(local_names.socket, "getaddrinfo", fail)
    monkeypatch.setattr(local_names.socket, "gethostname", lambda: "foreign")
    for key in ("ROS_IP", "ROS_HOSTNAME"):
        monkeypatch.setenv(key, "")  # so that it is put back
    return monkeypatch


def test_what_the_user_has_set_stays(unknown: Any) -> None:
    unknown.setenv("ROS_HOSTNAME", "robot")
    assert "foreign" not in local_names.use_loopback()
    assert os.environ["ROS_IP"] == ""


def test_names_without_addresses_are_reported(unknown: Any) -> None:
    assert local_names.use_loopback().endswith(
        "plain roslaunch needs the line '127.0.0.1 localhost', and the line '127.0.1.1 foreign' in /etc/hosts"
    )
    assert os.environ["ROS_IP"] == "127.0.0.1"
    assert local_names.master_uri(7) == "http://127.0.0.1:7"


def test_names_with_addresses_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(local_names.socket, "getaddrinfo", lambda name, port: ["there"])
    for key in ("ROS_IP", "ROS_HOSTNAME"):
        monkeypatch.setenv(key, "")
    assert local_names.use_loopback() == ""
    assert os.environ["ROS_IP"] == ""
    assert local_names.master_uri(7) == "http://localhost:7"
    assert local_names.launch_tool("rostest")[-2:] == ["localhost", "rostest"]

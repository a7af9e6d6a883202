# SPDX-License-Identifier: Apache-2.0
"""The part of the suite that depends most on a machine passes in the environments that users have.

It is marked ``everywhere``. ``make test`` runs it where all is unusual at once; ``make soak`` what starts no
process also with a home that can be written, and all in environments with one unusual thing, which says what
a failure is due to.
"""

import contextlib
import os
import shutil
import socket
import subprocess
import tempfile
from pathlib import Path
from typing import Dict, Iterator, List, NamedTuple, Tuple

import pytest
from chaos.under_test import processes

ROOT = Path(__file__).resolve().parents[2]
LIMIT = 1300.0  # s for the tests, on a machine that does much else
ONE = 400.0  # s for one of them: so that one which hangs is named, with its stacks
BUSY_PORTS = (11311, 8080)
#: A ROS that is another workspace's, and robot's: none of its folders, names and addresses is there.
OTHER_WORKSPACE = {
    "ROS_MASTER_URI": "http://robot.invalid:11311",
    "ROS_PACKAGE_PATH": "/nowhere/src",
    "CMAKE_PREFIX_PATH": "/nowhere/devel",
    "ROS_IP": "198.51.100.7",
    "ROS_NAMESPACE": "/other",
    "ROS_LOG_DIR": "/proc/nowhere",
    "ROSCONSOLE_FORMAT": "${message} ${nothing}",
}
#: What a user's own numpy would do, which is newer than that of Debian's packages.
OLD_PACKAGE = "raise ImportError('the packages in ~/.local are the user\\'s own')\n"


class Environment(NamedTuple):
    """How a user's environment differs from that of a new account; `{home}` is a folder of its own."""

    variables: Dict[str, str] = {}
    shell: str = ":"  # commands before the tests, as the user
    machine: str = (
        ""  # commands in namespaces of mounts, names and network, as root; the tests are a user's then
    )
    busy: bool = False  # the ports that ROS and the page like best are taken


ORDINARY = "ip link set lo up"
#: Takes ports in namespaces of their own, until what is marked is killed.
HOLD = """exec 9< <(python3 -c '
import signal, socket
holders = [socket.create_server(("", port)) for port in {ports}]
print(flush=True)
signal.pause()
' 2>/dev/null); read -r -u 9 _"""
ONE_BY_ONE = {
    "terminal": Environment({"TERM": "dumb", "COLUMNS": "20", "LINES": "3", "NO_COLOR": "1"}),
    "time_zone": Environment({"TZ": "Pacific/Chatham"}),
    "locale": Environment({"LANG": "C", "LC_ALL": "C"}),
    "python": Environment({"PYTHONHASHSEED": "7", "PYTHONUNBUFFERED": "1", "PYTHONDONTWRITEBYTECODE": "1"}),
    "umask": Environment(shell="umask 077"),
    "old_ros_folder": Environment(shell="cp -r {home}/old/. $HOME"),
    "user_packages": Environment(shell="cp -r {home}/local $HOME/.local"),
    "other_workspace": Environment(OTHER_WORKSPACE),
    "busy_ports": Environment(busy=True),
    "ordinary_user": Environment(machine=ORDINARY),
    "home_not_writable": Environment({"HOME": "{home}/none"}, "chmod 555 {home}/none", ORDINARY),
    "no_ipv6": Environment(machine=f"{ORDINARY}; echo 1 >/proc/sys/net/ipv6/conf/all/disable_ipv6"),
    "names_without_addresses": Environment(
        machine=f"{ORDINARY}; hostname of-no-address; mount --bind {{home}}/hosts /etc/hosts; "
        "mount --bind {home}/nsswitch.conf /etc/nsswitch.conf"
    ),
}


def joined(*names: str) -> Environment:
    """Several environments in one."""
    chosen = [ONE_BY_ONE[name] for name in names]
    return Environment(
        {name: value for each in chosen for name, value in each.variables.items()},
        "; ".join(each.shell for each in chosen),
        "; ".join(each.machine for each in chosen if each.machine),
        any(each.busy for each in chosen),
    )


@pytest.fixture
def home() -> Iterator[Path]:
    """A folder for the user, below a short path: sockets have a limit."""
    folder = Path(tempfile.mkdtemp(prefix="merlin-"))
    (folder / "hosts").write_text("127.0.0.1 localhost\n", encoding="utf-8")
    (folder / "nsswitch.conf").write_text("passwd: files\ngroup: files\nhosts: files\n", encoding="utf-8")
    runs = folder / "old" / ".ros" / "merlin" / "runs"
    runs.mkdir(parents=True)
    (runs / "1.json").write_text('{"pid": 1, "uri": "of an older form"}', encoding="utf-8")
    (runs / "2.json").write_bytes(b"\xff cut off")
    (runs.parent / "operators.yaml").write_text("[", encoding="utf-8")
    packages = folder / "local" / "lib" / python_folder() / "site-packages"
    packages.mkdir(parents=True)
    (packages / "numpy.py").write_text(OLD_PACKAGE, encoding="utf-8")
    (folder / "none").mkdir()
    yield folder
    (folder / "none").chmod(0o755)
    shutil.rmtree(str(folder))


def python_folder() -> str:
    """The folder of the workspace's Python below lib, "python3.11"."""
    return next((ROOT / ".venv" / "lib").glob("python3*")).name


def namespaces() -> List[str]:
    """The command before one that is root in namespaces of its own; skips where they are refused."""
    root = [] if os.geteuid() == 0 else ["--user", "--map-root-user"]
    command = ["unshare", *root, "--mount", "--uts", "--net", "bash", "-ec"]
    needed = (
        f"{ORDINARY}; mount --bind /etc/hosts /etc/hosts; hostname tried; unshare --user --map-user=1000 true"
    )
    try:
        tried = subprocess.run([*command, needed], capture_output=True, text=True, check=False)
    except FileNotFoundError:
        pytest.skip("there is no unshare")
    if tried.returncode:
        pytest.skip(f"namespaces are refused: {tried.stderr.strip()}")
    return command


@contextlib.contextmanager
def taken(ports: Tuple[int, ...]) -> Iterator[None]:
    """Takes ports, also those that another process holds already."""
    with contextlib.ExitStack() as stack:
        for port in ports:
            holder = stack.enter_context(socket.socket())
            with contextlib.suppress(OSError):
                holder.bind(("", port))
                holder.listen()
        yield


def passes(environment: Environment, home: Path, which: str = "everywhere and not long") -> None:
    """Runs the tests whose marks fit, and fails with what they print."""
    files = [
        path for path in (ROOT / "test" / "unit").rglob("test_*.py") if "mark.everywhere" in path.read_text()
    ]
    tests = ["-n", "0", "-vv", "-rs", "-o", f"timeout={ONE}", "-m", which]
    tests += map(str, sorted(files))
    words = [str(ROOT / "tools" / "in_workspace.sh"), "python", "-m", "pytest", *tests]
    shell = ["bash", "-ec", environment.shell.format(home=home) + '; exec "$@"', "bash", *words]
    if environment.machine:
        # Root owns the workspace, and so does the user, who has no right beyond that.
        machine = environment.machine.format(home=home)
        if environment.busy:
            machine += "; " + HOLD.format(ports=BUSY_PORTS)
        machine += '; exec unshare --user --map-user=1000 "$@"'
        shell = [*namespaces(), machine, "bash", *shell]
    env = {"PATH": os.environ["PATH"], "LANG": "C.UTF-8", "HOME": "{home}", **environment.variables}
    env = {name: value.replace("{home}", str(home)) for name, value in env.items()}
    env[processes.MARK] = home.name
    try:
        done = subprocess.run(
            shell,
            env={**env, "TMPDIR": str(home)},
            cwd=str(home),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            timeout=LIMIT,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        pytest.fail(
            f"not done after {LIMIT:.0f} s; the last of it:\n{(error.output or b'')[-12000:].decode()}"
        )
    finally:
        processes.kill_marked(home.name)
    assert done.returncode == 0 and " passed" in done.stdout, done.stdout[-12000:]
    print(done.stdout[-2000:])


UNUSUAL = (
    "terminal",
    "time_zone",
    "locale",
    "umask",
    "old_ros_folder",
    "user_packages",
    "other_workspace",
    "busy_ports",
)


def unusual_variables(home: Path) -> None:
    with taken(BUSY_PORTS):
        passes(joined(*UNUSUAL), home, "everywhere and not long and not processes")


@pytest.mark.long
def test_with_unusual_variables(home: Path) -> None:
    unusual_variables(home)


def test_an_ordinary_user_where_all_is_unusual(home: Path) -> None:
    """Where namespaces are refused, the variables alone are unusual."""
    try:
        namespaces()
    except pytest.skip.Exception:
        unusual_variables(home)
        raise
    passes(joined(*UNUSUAL, "home_not_writable", "no_ipv6", "names_without_addresses"), home)


@pytest.mark.long
@pytest.mark.parametrize("name", ONE_BY_ONE)
def test_in_each_environment(name: str, home: Path) -> None:
    environment = ONE_BY_ONE[name]
    with taken(BUSY_PORTS if environment.busy else ()):
        passes(environment, home)


@pytest.mark.parametrize("name", ["my robot", "a:b", "it's"])
def test_a_path_that_catkin_cannot_use_is_refused_at_once(name: str, tmp_path: Path) -> None:
    tools = tmp_path / name / "tools"
    tools.mkdir(parents=True)
    shutil.copy(str(ROOT / "tools" / "build.sh"), str(tools))
    shutil.copy(str(ROOT / "Makefile"), str(tools.parent))
    done = subprocess.run(
        ["make", "-C", str(tools.parent), "build"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert f"{tools.parent}' has a blank, or another character that catkin cannot use; move" in done.stderr


MAKEFILE = """
test:
	@env; tty; (setsid sleep 1000 &); exit 3
"""


def test_continuous_integration_has_what_a_newcomer_has(tmp_path: Path) -> None:
    (tmp_path / ".ci").mkdir()
    run = shutil.copy(str(ROOT / ".ci" / "run"), str(tmp_path / ".ci"))
    (tmp_path / "Makefile").write_text(MAKEFILE, encoding="utf-8")
    env = {
        "PATH": os.environ["PATH"],
        "HOME": str(tmp_path),
        "PIP_TIMEOUT": "9",
        "TERM": "xterm",
        "PYTHONPATH": "/x",
    }
    done = subprocess.run([run], env=env, capture_output=True, text=True, timeout=LIMIT, check=False)
    assert done.returncode == 2, "that of make"
    assert "not a tty" in done.stdout
    variables = dict(line.split("=", 1) for line in done.stdout.splitlines() if "=" in line)
    assert variables["PIP_TIMEOUT"] == "9" and variables["PATH"] == env["PATH"]
    made_by_make = {"MAKEFLAGS", "MAKELEVEL", "MAKE_TERMERR", "MAKE_TERMOUT", "MFLAGS", "PWD", "SHLVL", "_"}
    assert set(variables) - made_by_make == {"HOME", "LANG", "PATH", "PIP_TIMEOUT"}
    assert "sleep 1000" in done.stderr, "killed, and named"
    home = Path(variables["HOME"])
    assert home != tmp_path and not home.exists()
    assert not [pid for pid in processes.ids() if f"HOME={home}" in environment_of(pid)]


def environment_of(pid: int) -> List[str]:
    """The variables of a process; empty when it has ended."""
    try:
        return Path(f"/proc/{pid}/environ").read_text(errors="replace").split("\0")
    except OSError:
        return []

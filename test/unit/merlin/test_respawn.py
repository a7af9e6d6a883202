# SPDX-License-Identifier: Apache-2.0
"""Launch-prefixes: of nodes that are started again or cannot begin, and of those that wake up too often."""

import contextlib
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import Callable, List, Sequence

import pytest

from merlin_test import LONG
from merlin_test.process_signals import gone

pytestmark = pytest.mark.processes

SCRIPTS = Path(__file__).parents[3] / "src" / "merlin" / "scripts"
RESPAWN = SCRIPTS / "respawn"
COARSE_TIMERS = SCRIPTS / "coarse_timers"
SLACK = Path("/proc/self/timerslack_ns")

# Adds its pid to a file, then does what its life's word says; the last word holds for all further lives. A
# word that begins with w tells the script first that the node works.
NODE = """
import os, signal, sys
lives, *words = sys.argv[1:-1]
codes = {signal.SIGTERM: 7, signal.SIGINT: 8}
for number in codes:
    signal.signal(number, lambda *_: None)  # also where the parent had it ignored
signal.pthread_sigmask(signal.SIG_BLOCK, codes)
with open(lives, "a") as file:
    file.write(f"{os.getpid()}\\n")
word = words[min(len(open(lives).readlines()), len(words)) - 1]
if word.startswith("w") and word != "wait":
    os.kill(int(os.environ["RESPAWN_PID"]), signal.SIGUSR1)
    word = word[1:]
if word in ("wait", "deaf"):
    print("ready", flush=True)
    while word == "deaf":
        signal.pause()
    sys.exit(codes[signal.sigwait(codes)])
if word.startswith("-"):
    os.kill(os.getpid(), -int(word))
sys.exit(int(word))
"""

# Stands in for `sleep`: the fourth pause of the script lasts as long as the script, the others not at all.
FOURTH_PAUSE = """#!/bin/sh
[ "$1" = 2 ] || exit 0
for _ in $(seq 600); do
  grep -q respawn /proc/$PPID/cmdline 2>/dev/null || exit 0
  /bin/sleep 0.1
done
"""

# Stands in for `env`, which binds a node: it ignores SIGINT, and goes on when the script waits for it.
BINDS = """#!/bin/sh
case $* in
  *--version) ;;
  *) echo binds; until [ -e {waits} ]; do grep -q respawn /proc/$PPID/cmdline && {sleep} 0.01 || exit; done ;;
esac
exec {env} "$@"
"""
# The same, and goes on when a file is there.
BINDS_LATE = """#!/bin/sh
case $* in *--version) ;; *) echo binds; until [ -e "{go_on}" ]; do {sleep} 0.01; done ;; esac
exec {env} "$@"
"""
WAITS = """#!/bin/sh
echo >{waits} && exec {sleep} "$1"
"""


class Run:
    """One run of the script, in a session of its own as roslaunch starts it."""

    def __init__(self, folder: Path, *words: str, node: Sequence[str] = ()) -> None:
        self.lives = folder / "lives"
        command = [sys.executable, "-c", NODE, str(self.lives), *words, "__name:=wheel"]
        self.process = subprocess.Popen(
            [str(RESPAWN), *(node or command)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            # As roslaunch starts it: what a script starts with & ignores SIGINT, which a shell cannot trap.
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )

    def pids(self) -> List[int]:
        return [int(line) for line in self.lives.read_text().split()] if self.lives.exists() else []

    def wait_ready(self) -> int:
        assert self.process.stdout is not None
        assert self.process.stdout.readline() == "ready\n"
        return self.pids()[-1]

    def end(self) -> List[str]:
        _, error = self.process.communicate(timeout=LONG)
        return [line for line in error.splitlines() if line.startswith("respawn: ")]


@pytest.fixture
def run(tmp_path: Path):
    started: List[Run] = []

    def start(*words: str, **how: Sequence[str]) -> Run:
        started.append(Run(tmp_path, *words, **how))
        return started[-1]

    yield start
    for one in started:
        for pid in (one.process.pid, *one.pids()):
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        one.process.communicate()


@pytest.mark.parametrize("code", [2, 126, 127])
def test_a_node_that_could_not_begin_is_not_started_again(run: Callable[..., Run], code: int) -> None:
    node = run(str(code))
    assert node.end() == []
    assert node.process.returncode == code and len(node.pids()) == 1


def test_a_node_that_does_not_handle_signals_yet_is_ended_by_ctrl_c(tmp_path: Path) -> None:
    one = Run(tmp_path, node=["sh", "-c", "echo ready; exec sleep 1000"])
    assert one.process.stdout is not None and one.process.stdout.readline() == "ready\n"
    one.process.send_signal(signal.SIGINT)
    assert one.end() == [] and one.process.returncode == 128 + signal.SIGINT


@pytest.mark.everywhere
def test_a_program_that_does_not_exist() -> None:
    done = subprocess.run([str(RESPAWN), "/nowhere/node"], capture_output=True, text=True, timeout=LONG)
    assert done.returncode == 127 and "/nowhere/node" in done.stderr


@pytest.mark.everywhere
@pytest.mark.parametrize(
    ("word", "how"),
    [("-9", "signal KILL"), ("-11", "signal SEGV"), ("1", "exit code 1"), ("0", "exit code 0")],
)
def test_a_node_that_died_starts_again(run: Callable[..., Run], word: str, how: str) -> None:
    node = run(word, word, "2")
    assert node.end() == [
        f"respawn: wheel died ({how}); it is started again, {count} of 5 times within 30 s"
        for count in (1, 2)
    ]
    assert node.process.returncode == 2 and len(node.pids()) == 3


@pytest.fixture
def no_pauses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The script starts a node again at once: its span has to suffice for six starts on a slow machine."""
    sleep = tmp_path / "sleep"
    sleep.write_text("#!/bin/sh\n")
    sleep.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")


@pytest.mark.parametrize(("word", "how", "code"), [("-9", "signal KILL", 137), ("0", "exit code 0", 1)])
def test_it_gives_up_in_the_end(
    run: Callable[..., Run], no_pauses: None, word: str, how: str, code: int
) -> None:
    node = run(word)
    assert node.end()[-1] == (
        f"respawn: wheel died ({how}) for the 6th time within 30 s; it is not started again"
    )
    assert node.process.returncode == code and len(node.pids()) == 6


@pytest.mark.parametrize("worked_in", ["this script", "one that was killed"])
def test_a_node_that_has_worked_and_cannot_begin_any_more_is_tried_until_it_can(
    run: Callable[..., Run], no_pauses: None, monkeypatch: pytest.MonkeyPatch, worked_in: str
) -> None:
    if worked_in == "this script":
        node = run("w-9", *["2"] * 7, "wait")
    else:
        monkeypatch.setenv("RESPAWN_WORKED", "yes")
        node = run("-9", *["2"] * 7, "wait")
    pid = node.wait_ready()
    assert len(node.pids()) == 9
    node.process.send_signal(signal.SIGTERM)
    said = node.end()
    assert node.process.returncode == 7 and gone(pid)
    assert said[1:] == [
        "respawn: wheel cannot begin any more (exit code 2): put right what it names; it is tried again in "
        f"{pause} s"
        for pause in (1, 2, 4, 8, 16, 30, 30)
    ]


def test_a_node_that_cannot_begin_after_a_crash_in_its_start_ends(run: Callable[..., Run]) -> None:
    node = run("1", "2")
    assert len(node.end()) == 1
    assert node.process.returncode == 2


@pytest.mark.parametrize("word, code", [("0", 0), ("2", 2), ("w2", 2), ("7", 7), ("128", 128), ("143", 143)])
def test_the_end_of_a_mission_is_the_end(
    run: Callable[..., Run], monkeypatch: pytest.MonkeyPatch, word: str, code: int
) -> None:
    monkeypatch.setenv("RESPAWN_KILLED", "only")
    started = run("-9", "-11", word)
    assert len(started.end()) == 2 and started.process.returncode == code
    assert len(started.pids()) == 3


def test_more_starts_on_demand(run: Callable[..., Run], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RESPAWN_MOST", "1")
    node = run("-9")
    assert len(node.end()) == 2 and len(node.pids()) == 2


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 8), (signal.SIGTERM, 7)])
@pytest.mark.parametrize("group", [True, False])
def test_a_stop_reaches_the_node_and_is_the_end(
    run: Callable[..., Run], number: signal.Signals, code: int, group: bool
) -> None:
    node = run("wait")
    pid = node.wait_ready()
    (os.killpg if group else os.kill)(node.process.pid, number)
    assert node.end() == []
    assert node.process.returncode == code and node.pids() == [pid]
    assert gone(pid)


def test_a_stop_while_it_waits_to_start_again(
    run: Callable[..., Run], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sleep = tmp_path / "sleep"  # the fourth pause lasts until the stop, however late that is
    sleep.write_text(FOURTH_PAUSE)
    sleep.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    node = run("-9")
    assert node.process.stderr is not None
    for line in node.process.stderr:
        if "4 of 5" in line:
            break
    node.process.send_signal(signal.SIGINT)
    assert node.process.wait(LONG) == 0
    assert len(node.pids()) == 4


def test_a_stop_while_a_node_begins_is_not_lost(
    run: Callable[..., Run], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    programs = {name: shutil.which(name) for name in ("env", "sleep")}
    for name, text in (("env", BINDS), ("sleep", WAITS)):
        (tmp_path / name).write_text(text.format(waits=tmp_path / "waits", **programs))
        (tmp_path / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    one = run(node=[programs["sleep"], "1000"])
    assert one.process.stdout is not None and one.process.stdout.readline() == "binds\n"
    one.process.send_signal(signal.SIGINT)
    assert one.end() == [] and one.process.returncode == 128 + signal.SIGINT


def test_a_node_that_does_not_listen_is_not_given_up(run: Callable[..., Run]) -> None:
    node = run("deaf")
    pid = node.wait_ready()
    os.killpg(node.process.pid, signal.SIGTERM)
    with pytest.raises(subprocess.TimeoutExpired):
        node.process.wait(0.5)
    os.killpg(node.process.pid, signal.SIGKILL)  # as roslaunch does in the end
    assert gone(pid)


@pytest.mark.everywhere
def test_the_node_ends_when_the_script_is_killed(run: Callable[..., Run]) -> None:
    node = run("wait")
    pid = node.wait_ready()
    node.process.kill()
    assert gone(pid)


def test_a_node_is_not_begun_when_the_script_is_killed_before_it_binds_it(
    run: Callable[..., Run], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    env, go_on = tmp_path / "env", tmp_path / "go on"
    env.write_text(BINDS_LATE.format(go_on=go_on, env=shutil.which("env"), sleep=shutil.which("sleep")))
    env.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    node = run("wait")
    assert node.process.stdout is not None and node.process.stdout.readline() == "binds\n"
    node.process.kill()
    node.process.wait()
    go_on.touch()
    assert node.process.stdout.readline() == "" and node.pids() == []


@pytest.fixture
def older(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Puts programs into PATH that do not know their newer options, as those of older systems."""

    def put(*programs: str) -> None:
        for name in programs:
            program = tmp_path / name
            program.write_text('#!/bin/sh\necho "what is $1?" >&2\nexit 125\n')
            program.chmod(0o755)
        monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")

    return put


def test_with_an_older_env_the_node_ends_when_the_script_is_killed(
    run: Callable[..., Run], older: Callable[..., None]
) -> None:
    older("env")
    node = run("wait")
    pid = node.wait_ready()
    node.process.kill()
    assert gone(pid)


def test_with_an_older_setpriv_ctrl_c_ends_a_node_that_does_not_handle_signals_yet(
    tmp_path: Path, older: Callable[..., None]
) -> None:
    older("setpriv")
    test_a_node_that_does_not_handle_signals_yet_is_ended_by_ctrl_c(tmp_path)


def test_with_older_programs_a_node_starts(run: Callable[..., Run], older: Callable[..., None]) -> None:
    older("env", "setpriv")
    node = run("-9", "2")
    assert len(node.end()) == 1 and node.process.returncode == 2


@pytest.mark.parametrize(
    "given, seen",
    [
        (None, "glibc.malloc.arena_max=1:glibc.malloc.tcache_count=0 1"),
        ("", " "),
        ("glibc.rtld.nns=4", "glibc.rtld.nns=4 "),
    ],
)
def test_the_c_library_keeps_no_memory_for_each_thread_unless_it_is_told_to(given: str, seen: str) -> None:
    environment = {name: value for name, value in os.environ.items() if name != "GLIBC_TUNABLES"}
    if given is not None:
        environment["GLIBC_TUNABLES"] = given
    command = [str(RESPAWN), "sh", "-c", 'echo "$GLIBC_TUNABLES $RESPAWN_TUNED"; exit 2']
    reported = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=LONG).stdout
    assert reported == f"{seen}\n"


@pytest.mark.skipif(not SLACK.exists(), reason=f"this kernel has no {SLACK}")
def test_coarse_timers_wake_a_program_up_to_20_ms_late() -> None:
    done = subprocess.run([COARSE_TIMERS, "cat", SLACK], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "20000000\n", "")


def test_coarse_timers_pass_on_words_and_exit_code() -> None:
    words = ["sh", "-c", 'printf "%s|" "$@"; exit 7', "sh", "a b", "__name:=node", ""]
    done = subprocess.run([COARSE_TIMERS, *words], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (7, "a b|__name:=node||", "")

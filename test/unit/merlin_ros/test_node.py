# SPDX-License-Identifier: Apache-2.0
"""A node that cannot begin says why, leaves its namesakes alone, and ends by a signal."""

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path
from socketserver import ThreadingMixIn
from typing import Any, Tuple
from xmlrpc.client import ServerProxy
from xmlrpc.server import SimpleXMLRPCServer

import pytest

from merlin_test import LONG
from merlin_test.node_path import LEAN

pytestmark = pytest.mark.processes

CANNOT_BEGIN = 2
NOT_YET = 1

NODE = """
import sys, rospy
from merlin_ros.node import run_node
def start():
    print("started", flush=True)
    def run():
        rospy.spin()
        rospy.loginfo("last line")
        print("over", flush=True)
    return run
sys.exit(run_node("somebody", start))
"""

PARAMETER = """
import sys, rospy
from merlin_ros.node import run_node
def start():
    print("rate", rospy.get_param("~rate"), flush=True)
sys.exit(run_node("somebody", start))
"""

REFUSED = """
import sys
from merlin_ros.node import run_node
from merlin_ros.parameters import ParameterError
def start():
    raise ParameterError("parameter ~x is missing")
sys.exit(run_node("somebody", start))
"""


READS = """
import sys, rospy
from merlin_ros.node import run_node
def start():
    print("begun", flush=True)
    sys.stdin.readline()
    rospy.get_param("~x")
sys.exit(run_node("somebody", start))
"""


LOGS = """
import sys, rospy
from merlin_ros.node import run_node
def start():
    sys.stdout.reconfigure(line_buffering=True)
    rospy.loginfo("not taken")
    rospy.logerr("nor is this")
    print("nor this", flush=True)
    open(sys.argv[1], "w").write("went on")
    return lambda: None
sys.exit(run_node("somebody", start))
"""


RESPAWN = Path(__file__).parents[3] / "src" / "merlin" / "scripts" / "respawn"

# In its first life it spoils its parameter and is killed.
SPOILT = """
import os, signal, sys, rospy
from merlin_ros.node import run_node
from merlin_ros.parameters import number
def start():
    first = not rospy.has_param("~rate")
    number("~rate", 1.0, 0.0)
    print("started", flush=True)
    if first:
        return lambda: (rospy.set_param("~rate", "fast"), os.kill(os.getpid(), signal.SIGKILL))
sys.exit(run_node("somebody", start))
"""


def begin(master: str, *args: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, "-c", LEAN + "from merlin_ros.node import init_node; init_node('asker')", *args],
        env={**os.environ, "ROS_MASTER_URI": master},
        stderr=subprocess.PIPE,
        text=True,
        timeout=LONG,
    )


@pytest.mark.everywhere
@pytest.mark.parametrize("master", ["nonsense", "http://", "http://localhost:nowhere", ""])
def test_an_address_that_is_none_is_named(master: str) -> None:
    run = begin(master)
    assert run.returncode == CANNOT_BEGIN
    assert run.stderr.startswith(f"asker: ROS_MASTER_URI is '{master}'; it has to be like http://")
    assert "Traceback" not in run.stderr


def test_a_node_is_ended_for_a_second_one_of_its_name_and_not_for_that_of_another(master: Any) -> None:
    node = master.node(NODE)
    node.expect("started")
    reason = "[/killed_one] Reason: new node registered with same name"
    with ServerProxy(master.address_of("/somebody")) as port:  # a node that was killed had it before
        assert port.shutdown("/master", reason) == [1, "that is another node", 0]
    assert node.process.poll() is None
    master.api.registerSubscriber("/somebody", "/topic", "std_msgs/String", "http://localhost:1")
    assert node.ended() == 0
    assert f"not for this node, which goes on: {reason}" in node.output


def test_a_node_that_cannot_begin_says_so_with_its_exit_code(master: Any) -> None:
    node = master.node(REFUSED)
    assert node.ended() == CANNOT_BEGIN
    assert "/somebody: parameter ~x is missing" in node.output


def test_a_node_that_has_worked_is_tried_again_when_it_cannot_begin_any_more(master: Any) -> None:
    node = master.spawn(str(RESPAWN), sys.executable, "-c", LEAN + SPOILT)
    node.expect("started")
    node.expect("cannot begin any more (exit code 2)")
    assert "~rate" in node.output
    master.api.setParam("/test", "/somebody/rate", 2)
    node.expect("started")
    assert node.end(signal.SIGTERM) == 143


def test_a_node_whose_master_goes_while_it_reads_parameters_says_so_and_is_started_again(master: Any) -> None:
    node = master.node(READS)
    node.expect("begun")
    master.kill()
    node.process.stdin.write("go on\n")
    node.process.stdin.flush()
    assert node.ended() == NOT_YET
    assert "/somebody: the ROS master does not answer: " in node.output
    assert "Traceback" not in node.output


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 0), (signal.SIGTERM, 143)])
def test_a_node_that_waits_for_its_master_ends_when_told_to(master: Any, number: int, code: int) -> None:
    master.kill()
    node = master.node(NODE)
    node.expect("waiting for it")
    assert node.end(number) == code
    assert "Traceback" not in node.output
    assert "started" not in node.output


@pytest.mark.everywhere
@pytest.mark.parametrize("output", [">/dev/full 2>&1", "2>&1 | true", ">&-", "2>&-", "<&- >&- 2>&-"])
def test_a_line_of_log_that_cannot_be_written_keeps_no_node_from_going_on(
    master: Any, tmp_path: Path, output: str
) -> None:
    went_on = tmp_path / "went_on"
    words = (sys.executable, "-c", LEAN + LOGS, str(went_on))
    node = master.spawn("bash", "-c", f'"$@" {output}', "bash", *words)
    node.ended()
    assert went_on.read_text() == "went on"


def test_a_log_file_on_a_full_disk_gives_no_traceback_for_each_line(master: Any, tmp_path: Path) -> None:
    node = master.node(LOGS, str(tmp_path / "went_on"), "__log:=/dev/full")
    node.ended()
    assert "nor is this" in node.output and "Logging error" not in node.output


@pytest.mark.everywhere
def test_a_node_waits_for_its_master(master: Any) -> None:
    master.kill()
    node = master.node(NODE)
    node.expect("waiting for it")
    master.start()
    node.expect("started")


def test_a_node_with_parameters_waits_for_its_master_too_and_says_so_once(master: Any) -> None:
    """Nodes with the names of ROSPlan are started so: ``rosrun … knowledgeBase _domain_path:=…``."""
    master.kill()
    node = master.node(PARAMETER, "_rate:=5")
    node.expect("waiting for it")
    master.start()
    node.expect("rate 5")
    assert node.output.count("no master at") == 1


@pytest.mark.parametrize(
    ("args", "name"),
    [
        ((), "/somebody"),
        pytest.param(("__name:=else",), "/else", marks=pytest.mark.long),
        (("__ns:=/robot",), "/robot/somebody"),
        (("__ns:=robot", "__name:=else"), "/robot/else"),
    ],
)
def test_a_second_node_of_a_name_is_refused_and_the_first_goes_on(master: Any, args: Any, name: str) -> None:
    first = master.node(NODE, *args)
    first.expect("started")
    address = master.address_of(name)
    second = master.node(NODE, *args)
    assert second.ended() == CANNOT_BEGIN
    assert f"node {name} runs already (process {first.process.pid} at {address})" in second.output
    assert "__name:=" in second.output
    assert "started" not in second.output
    assert master.address_of(name) == address
    assert first.end() == 0
    assert "shutdown request" not in first.output


@pytest.mark.everywhere
def test_the_same_name_in_another_namespace_is_another_name(master: Any) -> None:
    for namespace in ("/one", "/two"):
        master.node(NODE, f"__ns:={namespace}").expect("started")


@pytest.mark.parametrize("refused", [True, False])
def test_a_signal_that_comes_while_the_process_ends_gives_no_traceback(master: Any, refused: bool) -> None:
    """As Ctrl-C of a launch ends nodes that are refused, or presses it twice."""
    again = "import atexit, os, signal\natexit.register(lambda: os.kill(os.getpid(), signal.SIGINT))\n"
    if refused:
        master.node(NODE).expect("started")
        node = master.node(again + NODE)
        assert node.ended() == CANNOT_BEGIN
    else:
        master.kill()
        node = master.node(again + NODE)
        node.expect("waiting for it")
        assert node.end(signal.SIGINT) == 0
    assert "Traceback" not in node.output


def test_a_node_that_hangs_keeps_its_name(master: Any) -> None:
    first = master.node(NODE)
    first.expect("started")
    first.send(signal.SIGSTOP)
    second = master.node(NODE)
    assert second.ended() == CANNOT_BEGIN
    assert "node /somebody runs already" in second.output
    assert "it hangs" in second.output
    assert "kill that one" in second.output
    first.send(signal.SIGCONT)
    assert first.end() == 0
    assert "shutdown request" not in first.output


class Threaded(ThreadingMixIn, SimpleXMLRPCServer):
    daemon_threads = True


def test_a_node_that_answers_late_does_not_hang(master: Any) -> None:
    asked, again = [], threading.Event()

    def name(caller: str) -> Tuple[int, str, str]:
        asked.append(caller)
        if len(asked) > 1:
            again.set()
        assert again.wait(LONG)
        return 1, "", "/somebody"

    with Threaded(("127.0.0.1", 0), logRequests=False) as late:
        late.register_function(name, "getName")
        late.register_function(lambda caller: (1, "", 4711), "getPid")
        threading.Thread(target=late.serve_forever, daemon=True).start()
        uri = f"http://127.0.0.1:{late.server_address[1]}/"
        master.api.registerSubscriber("/somebody", "/old", "std_msgs/Empty", uri)
        second = master.node(NODE)
        assert second.ended() == CANNOT_BEGIN
        late.shutdown()
    assert f"node /somebody runs already (process 4711 at {uri})" in second.output


@pytest.mark.parametrize("times", [2, pytest.param(5, marks=pytest.mark.long)])
def test_a_killed_node_is_started_again_each_time(master: Any, times: int) -> None:
    node = master.node(NODE)
    node.expect("started")
    for _ in range(times):
        node.end(signal.SIGKILL)
        node = master.node(NODE)
        node.expect("started")
    assert node.end() == 0
    assert "shutdown request" not in node.output


def test_the_port_of_a_dead_node_that_another_node_has_is_no_obstacle(master: Any) -> None:
    other = master.node(NODE, "__name:=else")
    other.expect("started")
    master.api.registerPublisher("/somebody", "/old", "std_msgs/Empty", master.address_of("/else"))
    node = master.node(NODE)
    node.expect("started")


def test_a_node_that_has_ended_is_not_registered_by_its_last_line(master: Any) -> None:
    node = master.node(NODE)
    node.expect("started")
    assert node.end() == 0
    assert "last line" in node.output
    assert master.address_of("/somebody") == ""


def test_the_last_line_of_a_node_does_not_end_the_next_of_its_name(master: Any) -> None:
    first = master.node(NODE)
    first.expect("started")
    # As a node of rospy's own does that starts beside it: the master ends the first one.
    next_one = master.node(
        NODE.replace("from merlin_ros.node import run_node", "").replace(
            'sys.exit(run_node("somebody", start))', 'rospy.init_node("somebody"); start()()'
        )
    )
    next_one.expect("started")
    assert first.ended() == 0
    assert "last line" in first.output
    assert next_one.process.poll() is None
    assert next_one.end() == 0
    assert "shutdown request" not in next_one.output


# Its main thread waits, and is not the one that the signal interrupts.
ELSEWHERE = """
import signal, sys, threading
from merlin_ros.node import run_node
def start():
    def interrupt():
        sys.stdin.readline()
        signal.pthread_kill(threading.get_ident(), signal.SIGINT)
    threading.Thread(target=interrupt, daemon=True).start()
    print("started", flush=True)
sys.exit(run_node("somebody", start))
"""


def test_a_signal_that_interrupts_another_thread_ends_a_node(master: Any) -> None:
    node = master.node(ELSEWHERE)
    node.expect("started")
    node.say("")
    assert node.process.wait(LONG) == 0


STORM = """
import os, signal, sys, threading
import rospy
from merlin_ros.node import run_node
def start():
    def storm():
        # Each of them interrupts the handlers of those before it.
        for _ in range(300):
            os.kill(os.getpid(), signal.SIGINT)
            os.kill(os.getpid(), signal.SIGTERM)
    threading.Thread(target=storm, daemon=True).start()
sys.exit(run_node("somebody", start))
"""


def test_signals_that_interrupt_each_other_end_a_node(master: Any) -> None:
    for _ in range(3):  # a node that hangs is a time-out here; a late signal may come behind its handlers
        ended = subprocess.run(
            [sys.executable, "-c", LEAN + STORM],
            env=dict(os.environ, ROS_MASTER_URI=master.uri),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            timeout=LONG,
        )
        assert ended.returncode in (0, -signal.SIGINT, -signal.SIGTERM)
        assert master.address_of("/somebody") == ""


LIGHT = """
import atexit, gc
atexit.register(lambda: print("spared:", gc.get_freeze_count() > 0, flush=True))
from merlin_ros.node import init_node
init_node("somebody")
"""


def test_a_node_ends_without_a_search_for_garbage(master: Any) -> None:
    node = master.node(LIGHT)
    node.ended()
    assert "spared: True" in node.output


LIMITS = """
import atexit, ctypes, threading
from merlin_ros import node
node.END_LIMIT = node.RETURN_LIMIT = 0.5
"""
# A busy machine may be late to what one of the two limits is about: the other one is far away then.
WAITS = """
import faulthandler
later = faulthandler.dump_traceback_later
faulthandler.dump_traceback_later = lambda _, exit: later(120.0, exit=exit)
atexit.register(threading.Event().wait)
"""
HOLDS_THE_INTERPRETER = """
start = threading.Timer.start
def patient(timer):
    timer.interval = 120.0
    start(timer)
threading.Timer.start = patient
atexit.register(ctypes.PyDLL(None).pause)
"""
BUSY = """
def begin_threads():
    while True:
        threading.Thread(target=sum, args=([1],)).start()
for _ in range(3):
    threading.Thread(target=begin_threads, daemon=True).start()
"""
COMMAND = """
node.init_node("somebody")
node.end_node("done")
"""
RUN = """
node.run_node("somebody", lambda: lambda: None)
"""


@pytest.mark.parametrize("ending", [COMMAND, RUN], ids=["command", "node"])
@pytest.mark.parametrize(
    ("hangs", "said", "where"),
    [
        (WAITS, "is ended by force", "in wait"),
        (HOLDS_THE_INTERPRETER, "Timeout", "Thread"),
        (WAITS + BUSY, "is ended by force", "in wait"),
    ],
    ids=["waits", "holds the interpreter", "threads begin and end"],
)
def test_what_hangs_while_python_ends_is_ended_and_says_where(
    master: Any, hangs: str, said: str, where: str, ending: str
) -> None:
    node = master.node(LIMITS + hangs + ending)
    assert node.ended() == 1
    assert said in node.output and where in node.output

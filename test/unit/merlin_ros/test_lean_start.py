# SPDX-License-Identifier: Apache-2.0
"""A node that starts lean has what every other has, once it asks for it."""

import os
import subprocess
import sys

import pytest

pytestmark = pytest.mark.processes


def run(text):
    done = subprocess.run(
        [sys.executable, "-c", f"import sys\nfrom merlin_ros import lean_start\n{text}"],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_what_is_not_asked_for_is_not_imported():
    assert not run(
        """
lean_start.prepare()
import rospy
from merlin_msgs.msg import PlannerStatus
PlannerStatus().header.stamp
import rosgraph
fat = {"numpy", "pyparsing", "unittest", "sensor_msgs.msg._Image", "merlin_msgs.msg._ExecuteGoal"}
print(*sorted(fat & set(sys.modules)))
"""
    ).strip()


def test_everything_is_there_when_it_is_asked_for():
    run(
        """
lean_start.prepare()
lean_start.prepare()
import rospy
from sensor_msgs.msg import *
assert PointCloud2 is sys.modules["sensor_msgs.msg._PointCloud2"].PointCloud2
from std_srvs.srv import Trigger, TriggerRequest, TriggerResponse
assert Trigger._request_class is TriggerRequest and Trigger._response_class is TriggerResponse
import geometry_msgs.msg
assert "PoseStamped" in dir(geometry_msgs.msg) and geometry_msgs.msg.PoseStamped().pose.position.x == 0
import roslib.message
assert roslib.message.get_message_class("nav_msgs/Odometry") is not None
import numpy
image = Image(data=numpy.zeros(4, numpy.uint8).tobytes(), height=numpy.uint32(2))
import io
image.serialize(io.BytesIO())
import std_msgs.msg
std_msgs.msg.Float64(numpy.float32(0.5)).serialize(io.BytesIO())
try:
    std_msgs.msg.Strin
except AttributeError as error:
    assert "Strin" in str(error)
else:
    raise SystemExit("a message that does not exist was found")
"""
    )


def test_the_search_for_files_works_when_it_is_called():
    run(
        """
lean_start.prepare()
import roslib.packages
assert roslib.packages.find_node("merlin_guard", "guard")
import catkin.find_in_workspaces as search
assert roslib.packages.find_node("merlin_guard", "guard")[0].endswith("/guard")
assert "get_workspaces" in dir(search) and callable(search.get_workspaces)
"""
    )


@pytest.mark.everywhere
def test_the_search_for_files_has_what_it_has():
    run(
        """
lean_start.prepare()
import catkin.find_in_workspaces as search
assert not hasattr(search, "nothing_of_this_name")
assert callable(search.get_workspaces) and search.find_in_workspaces.__module__ == search.__name__
"""
    )


def test_a_node_is_found_without_reading_every_package():
    assert not run(
        """
lean_start.prepare()
import roslib.packages
(first, *_) = roslib.packages.find_node("merlin_guard", "guard")
assert first.endswith("/guard"), first
print(*sorted({"catkin_pkg.package", "pyparsing"} & set(sys.modules)))
from catkin.workspace import get_source_paths, get_workspaces
(source, *_) = get_source_paths(get_workspaces()[0])
lean = lean_start.find_packages(source)
whole = lean_start.find_packages(source, warnings=[])
import catkin_pkg.package, catkin_pkg.packages
assert catkin_pkg.packages.find_packages is not lean_start.find_packages
assert all(isinstance(package, catkin_pkg.package.Package) for package in whole.values())
facts = [{path: (each.name, each.version) for path, each in found.items()} for found in (lean, whole)]
assert facts[0] == facts[1]
"""
    ).strip()


LAZY = """
import builtins, sys, threading
builtins.entered, builtins.go, builtins.runs = threading.Event(), threading.Event(), []
sys.path.insert(0, {folder!r})
lean_start.LAZY["some_module"] = dict()
lean_start.prepare()
import some_module
"""
SOME_MODULE = """
runs.append(1)
first = 1
entered.set()
go.wait(300.0)
last = 2
"""


def lazily(folder, text):
    (folder / "some_module.py").write_text(SOME_MODULE)
    return run(LAZY.format(folder=str(folder)) + text)


@pytest.mark.everywhere
def test_a_node_that_has_checked_a_plan_prints_nothing_at_its_end():
    text = "lean_start.end_lightly()\nfrom merlin_pddl.checks import kairos_check\nkairos_check.load()"
    command = [sys.executable, "-c", f"from merlin_ros import lean_start\n{text}"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_threads_that_use_a_lazy_module_at_once_import_it_once_and_get_all_of_it(tmp_path):
    lazily(
        tmp_path,
        """
assert not runs
import queue
seen = queue.SimpleQueue()
def use(name):
    seen.put((getattr(some_module, name), hasattr(some_module, "last")))
threads = [threading.Thread(target=use, args=(name,)) for name in ("first", "last", "first")]
threads[0].start()
assert entered.wait(300.0)
for thread in threads[1:]:
    thread.start()
go.set()
for thread in threads:
    thread.join(300.0)
assert sorted(seen.get(timeout=300.0) for _ in threads) == [(1, True), (1, True), (2, True)]
assert len(runs) == 1 and type(some_module) is type(sys)
""",
    )


@pytest.mark.everywhere
def test_a_thread_that_has_begun_to_use_a_lazy_module_while_another_imports_it_gets_it(tmp_path):
    lazily(
        tmp_path,
        """
go.set()
begun = type(some_module).__getattribute__  # Python has found it, and has not called it yet
assert some_module.first == 1
assert (begun(some_module, "last"), len(runs)) == (2, 1)
""",
    )


@pytest.mark.everywhere
def test_a_lazy_module_is_what_an_eager_one_is(tmp_path):
    lazily(
        tmp_path,
        """
go.set()
assert some_module.__name__ == "some_module" and not runs
some_module.last = 3  # set from outside, before anything of it was used
assert (some_module.first, some_module.last, len(runs)) == (1, 3, 1)
assert sorted(name for name in vars(some_module) if name[:2] != "__") == ["first", "last"]
try:
    some_module.nothing
except AttributeError as error:
    assert "some_module" in str(error)
else:
    raise SystemExit("it has what it does not have")
import importlib
importlib.reload(some_module)
assert (some_module.last, len(runs)) == (2, 2)
del sys.modules["some_module"]
from some_module import *
assert (last, len(runs)) == (2, 3)
""",
    )


@pytest.mark.everywhere
def test_what_keeps_a_lazy_module_from_being_imported_is_said_each_time(tmp_path):
    (tmp_path / "some_module.py").write_text("first = 1\nraise OSError('too many open files')")
    run(
        LAZY.format(folder=str(tmp_path))
        + """
for _ in range(2):
    try:
        some_module.last
    except OSError as error:
        assert "too many" in str(error)
    else:
        raise SystemExit("nothing was said")
"""
    )


@pytest.mark.everywhere
def test_every_lazy_module_works():
    run(
        """
lean_start.prepare()
import rospy.core, hashlib, yaml, ssl, shutil, calendar, html, pprint, ipaddress, xml.dom.minidom as dom
assert rospy.core.md5(b"x").hexdigest() == hashlib.md5(b"x").hexdigest()
assert "_hashlib" not in sys.modules
assert hashlib.sha512(b"x").hexdigest() and hashlib.md5(b"x").hexdigest() == rospy.core.md5(b"x").hexdigest()
assert yaml.safe_load("[1, a]") == [1, "a"] and yaml.YAMLError
assert ssl.create_default_context().check_hostname and issubclass(ssl.SSLError, OSError)
assert shutil.which("sh") and calendar.timegm((1970, 1, 2, 0, 0, 0)) == 86400 and html.escape("<") == "&lt;"
assert pprint.pformat([1]) == "[1]" and ipaddress.ip_address("::1").is_loopback
assert dom.parseString("<a b='1'/>").documentElement.getAttribute("b") == "1"
import inspect, platform, pickle, random, textwrap, tokenize, ast, difflib, mimetypes, ctypes, xmlrpc.server
import xml.etree.ElementTree as trees
assert inspect.currentframe().f_code.co_name == "<module>" and platform.system() == "Linux"
assert platform.release() and callable(inspect.signature)
assert "<title>" in xmlrpc.server.ServerHTMLDoc().page("a title", "contents")
assert str(inspect.signature(lambda a: a)) == "(a)" and platform.python_version()
assert pickle.loads(pickle.dumps([1])) == [1] and random.random() < 1.0 and textwrap.indent("a", " ") == " a"
assert trees.ElementTree(trees.fromstring("<a/>")).getroot().tag == "a" and ast.literal_eval("1") == 1
assert difflib.get_close_matches("ab", ["abc"]) and mimetypes.guess_type("a.html")[0] == "text/html"
assert tokenize.NAME and ctypes.sizeof(ctypes.c_int64) == 8
import email.utils
assert email.utils.mktime_tz(email.utils.parsedate_tz("Thu, 01 Jan 1970 00:00:01 +0000")) == 1
"""
    )


def test_what_a_node_imports_is_not_looked_through_for_garbage_again(tmp_path):
    (tmp_path / "some_node.py").write_text(
        "import gc\n"
        "assert not gc.isenabled()\n"
        "things = [[number] for number in range(5000)]\n"
        "def main(): return 0 if gc.isenabled() and not any(things[0] is thing for generation in (0, 1)"
        " for thing in gc.get_objects(generation)) and not gc.get_freeze_count() else 1\n"
    )
    run(f"sys.path.insert(0, {str(tmp_path)!r})\nlean_start.run('some_node')")


@pytest.mark.parametrize("extension", ["conf", "yaml", None])
def test_the_log_is_configured_as_without_the_short_cut(extension, tmp_path):
    """Its file is found as rospy finds it: ROS_HOME's before that of the system."""
    if extension:
        (tmp_path / "config").mkdir()
        (tmp_path / "config" / f"python_logging.{extension}").touch()
    text = """
import os, rospkg
os.environ["ROS_HOME"] = HOME
os.environ["ROS_ETC_DIR"] = HOME + "/nowhere"
with lean_start.log_configured():
    print(os.environ.get("ROS_PYTHON_LOG_CONFIG_FILE", ""))
assert "ROS_PYTHON_LOG_CONFIG_FILE" not in os.environ
os.environ["ROS_PYTHON_LOG_CONFIG_FILE"] = "/mine"
with lean_start.log_configured():
    assert os.environ["ROS_PYTHON_LOG_CONFIG_FILE"] == "/mine"
"""
    found = run(
        f"import os\nos.environ.pop('ROS_PYTHON_LOG_CONFIG_FILE', 0)\nHOME = {str(tmp_path)!r}\n{text}"
    )
    assert found.strip() == (str(tmp_path / "config" / f"python_logging.{extension}") if extension else "")


def test_rospy_finds_the_folder_of_the_log(tmp_path):
    folder = tmp_path / "home" / "log"
    found = run(
        f"""
import os
os.environ["ROS_LOG_DIR"] = {str(folder)!r}
for _ in range(2):
    with lean_start.log_configured():
        print(os.path.isdir(os.environ["ROS_LOG_DIR"]))
"""
    )
    assert found.split() == ["True", "True"]


SCOPES = {
    "knowledge_base": "rosplan_knowledge_base",
    "problem_interface": "rosplan_problem_interface",
    "planner_interface": "rosplan_planner_interface",
    "plan_parser": "rosplan_parsing_interface",
    "plan_dispatcher": "rosplan_plan_dispatcher",
}
# The main thread comes to `prepare_all` when the node serves.
NODE = """
import sys, threading
from merlin_ros.lean_start import prepare, run
prepare()
import xmlrpc.client
from merlin_rosplan.transport.component import Component
asked, request = [], xmlrpc.client.Transport.single_request
def count(*args):
    if threading.current_thread().name != "master keeper":  # which asks again and again
        asked.append(args[3])
    return request(*args)
xmlrpc.client.Transport.single_request = count
prepare_all = Component.prepare_all
def serve():
    print("ready", sorted(set({fat}) & set(sys.modules)), flush=True)
    print("asked", min(len(asked), 12), flush=True)
    prepare_all()
    print("prepared", flush=True)
Component.prepare_all = staticmethod(serve)
run("merlin_rosplan.nodes.planning_system", "run_kind", "{kind}")
"""
#: What a node needs only later, or never, by the module that its import would bring.
LATER = {
    *(
        "_ctypes",
        "_hashlib",
        "_opcode",
        "_pickle",
        "_posixsubprocess",
        "_sqlite3",
        "_ssl",
        "locale",
        "ntpath",
    ),
    *("numpy", "pyparsing", "sysconfig", "unittest", "xml.etree.ElementPath", "yaml.reader"),
}


@pytest.mark.parametrize(
    "kind, own",
    [
        ("knowledge_base", {"merlin_rosplan.planning.planner", "merlin_rosplan.dispatcher.plan_dispatcher"}),
        ("problem_interface", {"merlin_pddl"}),
        ("planner_interface", {"merlin_pddl"}),
        ("plan_parser", {"merlin_pddl"}),
        ("plan_dispatcher", {"merlin_pddl.formula", "merlin_pddl.knowledge"}),
    ],
)
def test_a_node_of_the_planning_system_answers_before_it_imports_what_it_needs_later(
    kind, own, master, tmp_path
):
    domain = tmp_path / "domain.pddl"
    domain.write_text("(define (domain d) (:predicates (p)))")
    master.api.setParam("/test", "/rosplan/domain_path", str(domain))
    master.api.setParam("/test", f"/{SCOPES[kind]}/domain_path", str(domain))
    node = master.node(NODE.format(kind=kind, fat=sorted(LATER | own)))
    assert node.expect("ready") == "ready []"
    assert node.expect("asked") != "asked 12", "each call of the master costs a start half a millisecond"
    assert node.expect("prepared")
    served = [name for name, _ in master.api.getSystemState("/test")[2][2]]
    assert any(name.startswith(f"/{SCOPES[kind]}/") and "logger" not in name for name in served)


@pytest.mark.parametrize(
    "module, fat",
    [
        ("merlin_sim.node.simulator_node", {"cv2", "scipy.stats", "matplotlib"}),
        ("merlin_reactive.navigation.navigation_node", {"cv2", "scipy.stats", "matplotlib"}),
        ("merlin_experiment.mission.measured_mission_node", {"cv2", "scipy", "matplotlib", "numpy"}),
        ("merlin_guard.guard_node", {"numpy"}),
        ("merlin_reactive.recognition.object_classes", {"cv2", "numpy"}),  # of the check before a start
    ],
)
def test_the_nodes_of_the_home_start_without_what_they_may_never_use(module, fat):
    text = f"lean_start.prepare()\nimport {module}\nprint(*{fat} & set(sys.modules))"
    assert not run(text).strip()


def test_a_patient_node_has_its_priority_back_when_it_runs(tmp_path):
    usual = os.getpriority(os.PRIO_PROCESS, 0)
    (tmp_path / "some_node.py").write_text(
        "import os, threading\n"
        "def nice(): return os.getpriority(os.PRIO_PROCESS, threading.get_native_id())\n"
        "imported = nice()\n"
        f"def main(): return 0 if (imported, nice()) == ({max(10, usual)}, {usual}) else 1\n"
    )
    text = f"sys.path.insert(0, {str(tmp_path)!r})\nlean_start.run('some_node', patient=True)"
    run(text)


@pytest.mark.everywhere
def test_a_patient_node_that_cannot_be_imported_says_why():
    text = "from merlin_ros import lean_start; lean_start.run('no_such_node', patient=True)"
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True)
    assert done.returncode == 1 and "no_such_node" in done.stderr


@pytest.mark.parametrize("returned, code", [(None, 0), (0, 0), (3, 3)])
def test_the_process_ends_with_what_the_function_returns(returned, code, tmp_path):
    (tmp_path / "some_node.py").write_text(f"def main():\n    return {returned}\n")
    text = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); from merlin_ros.lean_start import run; "
    done = subprocess.run([sys.executable, "-c", text + "run('some_node')"])
    assert done.returncode == code

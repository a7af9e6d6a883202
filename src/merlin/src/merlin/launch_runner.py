# SPDX-License-Identifier: Apache-2.0
"""Runs an application: `rosrun merlin run <launch file> name:=value …`.

Everything of the launch file is started below a ROS master of its own. The run ends when the node named
`mission` ends, with that node's exit code; when a required node dies; or on SIGINT, SIGTERM, SIGHUP.
The wrapper of a node (the script `respawn`) that is killed is started again.
Nothing is left running. The screen belongs to the mission: what the others print goes to the log folder,
their warnings and errors (stderr) excepted.
"""

import contextlib
import os
import queue
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Callable, Dict, List, NamedTuple, Optional, Set, Union

import roslaunch
import roslib
import rospkg
from roslaunch.core import Node, RLException
from roslaunch.pmon import ProcessListener

from merlin.error_relay import ErrorRelay, LogFile
from merlin.launch_config import HOSTS, check_executables, check_files, full_name, read_launch, values_of
from merlin.launch_request import HelpWanted, LaunchError, LaunchRequest, one_line
from merlin.linger import Page, keep, lingers, page_of, terminal
from merlin.local_names import LOCALHOST, LOOPBACK, given_address, master_uri, resolves, use_loopback
from merlin.master import Master, MasterError
from merlin.running import announced
from merlin.supervision import WRAPPER_SPAN, Restarts, end_children
from merlin_ros.lean_start import end_lightly
from merlin_ros.processes.process_tree import adopt_orphans, end_with
from merlin_ros.processes.tidy_end import handled, signal_name

MISSION_NODE = "mission"
#: The script that starts a node again which has died, as a launch-prefix.
WRAPPER = "respawn"
#: Tells it that its node has worked before.
WORKED = {"RESPAWN_WORKED": "yes"}
#: Wall seconds between SIGINT and SIGTERM of a node that does not end (a bag is being closed).
INTERRUPT_TIMEOUT = 15.0
#: Wall seconds between SIGTERM and SIGKILL.
TERMINATE_TIMEOUT = 1.0
#: Wall seconds after which a signal that did not wake the run is seen at the latest.
LOOK_FOR_SIGNALS = 0.5
#: Wall seconds in which roslaunch reports a death for which it has ended a start.
DEATH_REPORT = 10.0
#: Program of the check beside a run, the id of whose process comes first. It ends with the run, also while it
#: imports, which takes minutes on a starved machine.
CHECK = """
import signal, sys
from merlin_ros.processes.process_tree import end_with
if not end_with(int(sys.argv.pop(1)), signal.SIGKILL):
    raise SystemExit(128 + signal.SIGKILL)
from merlin.check import main_at_start
raise SystemExit(main_at_start())
"""
#: Bytes of a disk on which nothing of a run can be kept.
LEAST_FREE = 2**20
KEPT = "logs, and knowledge that is kept there, are lost, and nodes may fail"
#: What helps where the user may not write to the folder of ROS.
WRITABLE = "set ROS_HOME, and ROS_LOG_DIR if you use it, to a folder that you may write to"
EXIT_FAILED = 1
EXIT_REFUSED = 2
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class _Death(NamedTuple):
    """A process of the run has ended."""

    process: str
    exit_code: Optional[int]
    follows: str = ""
    """What follows for a wrapper that was killed, as the end of a sentence."""
    again: bool = False
    """Whether it is started again."""


_Event = Union[signal.Signals, _Death]


class _Parent(roslaunch.parent.ROSLaunchParent, ProcessListener):
    """roslaunch on a master that runs already; every death from the first process on reaches `events`."""

    def __init__(
        self, run_id: str, request: LaunchRequest, port: int, events: "queue.SimpleQueue[_Event]"
    ) -> None:
        super().__init__(
            run_id,
            [(str(request.launch_file), request.words())],
            port=port,
            show_summary=False,
            sigint_timeout=INTERRUPT_TIMEOUT,
            sigterm_timeout=TERMINATE_TIMEOUT,
        )
        self._request = request
        self._events = events
        self._needed: Set[str] = set()  # names of the nodes with whose end the run ends
        self._wrapped: Dict[str, Restarts] = {}  # the same of those whose wrapper is started again
        self._lives: Dict[str, int] = {}  # process -> its last life of which the death was reported

    def load(self) -> None:
        """Reads the launch file.

        :raises LaunchError: it, or a file it includes, cannot be read, or it names a file that is missing.
        """
        self.config = read_launch(self._request, self.port)
        check_files(values_of(self.config))
        # roslaunch starts its core nodes (rosout) only together with a master of its own.
        self.config.nodes.extend(self.config.nodes_core)
        check_executables(self.config.nodes)
        for node in self.config.nodes:
            node.output = "screen" if node.name == MISSION_NODE else "log"
            if node.required:
                self._needed.add(full_name(node))
            if WRAPPER in (Path(word).name for word in (node.launch_prefix or "").split()):
                self._wrapped[full_name(node)] = Restarts(WRAPPER_SPAN)
                node.required, node.respawn = False, True  # roslaunch asks for each death whether it is so

    def _start_pm(self) -> None:
        super()._start_pm()
        self.pm.add_process_listener(self)

    def process_died(self, process_name: str, exit_code: Optional[int]) -> None:
        """Called by roslaunch's process monitor, again and again while a process waits for its next start."""
        process, node = self.pm.get_process(process_name), self.node_of(process_name)
        restarts = self._wrapped.get(full_name(node)) if node is not None else None
        if process is None or restarts is None:
            self._events.put(_Death(process_name, exit_code))
            return
        if self._lives.get(process_name) == process.spawn_count:
            return
        self._lives[process_name] = process.spawn_count
        killed = exit_code is not None and exit_code < 0
        pause = restarts.died() if killed else None
        process.respawn, process.respawn_delay = pause is not None, pause or 0.0
        process.env = {**process.env, **WORKED}
        if pause is None and self.needs(node):
            self.pm.shutdown()
        self._events.put(_Death(process_name, exit_code, restarts.words if killed else "", pause is not None))

    def needs(self, node: Optional[Node]) -> bool:
        """Whether the run ends with a node."""
        return node is not None and full_name(node) in self._needed

    def node_of(self, process: str) -> Optional[Node]:
        """The launch file's entry of a process."""
        return next((node for node in self.config.nodes if node.process_name == process), None)


class LaunchRun:
    """One run, from the first process to the last.

    :param request: what is run.
    :param command: that the user has given, for messages.
    :param on_end: called when the run ends by itself, before its nodes are ended.
    :ivar log_folder: where the nodes' logs are.
    """

    def __init__(
        self, request: LaunchRequest, command: str = "merlin run", on_end: Callable[[], None] = lambda: None
    ) -> None:
        self._request = request
        self._command = command
        self._on_end = on_end
        self._events: queue.SimpleQueue[_Event] = queue.SimpleQueue()
        self._master: Optional[Master] = None
        self._parent: Optional[_Parent] = None
        self._missions: Dict[str, Optional[int]] = {}
        self._run_id = roslaunch.core.generate_run_id()
        self._page: Optional[Page] = None
        self._check: Optional[subprocess.Popen[bytes]] = None
        self._user_ended = False
        self._began = time.time()
        self.log_folder = Path(rospkg.get_log_dir()) / self._run_id

    @property
    def page(self) -> Optional[Page]:
        """What is left of its page; None when there is nothing, or when its user has ended the run."""
        page = None if self._user_ended else self._page
        return page if page is not None and page.written_since(self._began) else None

    def run(self) -> int:
        """Runs to the end.

        :return: the exit code: the mission's, 128 + signal, or 1 and 2 for a failed or refused run.
        """
        for folder in (Path(rospkg.get_ros_home()), self.log_folder):  # nodes are started in the first
            try:
                folder.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                why = f"the folder {folder} cannot be made: {error.strerror}"
                print(f"{self._command}: {why}; {WRITABLE}", file=sys.stderr)
                return EXIT_REFUSED
        if shutil.disk_usage(self.log_folder).free < LEAST_FREE:
            print(
                f"{self._command}: the disk of {self.log_folder} is full: {KEPT}; {WRITABLE}", file=sys.stderr
            )
        adopt_orphans()
        _bind_nodes()
        roslib.set_interactive(True)  # else roslaunch takes the signal handlers for itself
        log = LogFile(self.log_folder / "run.log")
        with handled(dict.fromkeys(SIGNALS, self._signalled)), contextlib.ExitStack() as stack:
            self._relay = stack.enter_context(ErrorRelay(log))
            # Nodes inherit the descriptors, not these objects: only roslaunch's own lines go to the file.
            stack.enter_context(contextlib.redirect_stdout(log))
            stack.enter_context(contextlib.redirect_stderr(log))
            stack.callback(self._stop)
            roslaunch.configure_logging(self._run_id)
            code = self._start_and_wait(stack)
            self._on_end()
        return code

    def _start_and_wait(self, stack: contextlib.ExitStack) -> int:
        try:
            self._master = Master(self._request.port)
            os.environ["ROS_MASTER_URI"] = uri = master_uri(self._master.port)
            if not resolves(LOCALHOST):
                roslaunch.core.local_machine().address = LOOPBACK
            self._parent = _Parent(self._run_id, self._request, self._master.port, self._events)
            self._parent.load()
            stack.enter_context(announced(uri, self._request.launch_file, self.log_folder))
            self._parent.start(auto_terminate=False)
        except (RLException, LaunchError, MasterError) as error:
            code = self._ended_while_it_started()
            if code is None:
                self._say(f"{self._request.launch_file.name}: {one_line(error)}{_advice(error)}")
                code = EXIT_REFUSED
            return code
        nodes = self._parent.config.nodes
        if any((node.package, node.type) in HOSTS for node in nodes):
            self._begin_check()
        self._page = page_of(nodes, values_of(self._parent.config))
        self._missions = {node.process_name: None for node in nodes if node.name == MISSION_NODE}
        if not self._missions:
            self._say(
                f"{self._request.launch_file.name} starts no node named 'mission': it runs until Ctrl-C"
            )
        while True:
            # A signal that comes between Python's last look for one and the wait does not end the wait.
            with contextlib.suppress(queue.Empty):
                code = self._handle(self._events.get(timeout=LOOK_FOR_SIGNALS))
                if code is not None:
                    return code

    def _begin_check(self) -> None:
        """Looks for what no node says of the application; the relay has what is found, as from a node."""
        words = [str(self._request.launch_file), *self._request.words()]
        command = [sys.executable, "-c", CHECK, str(os.getpid()), *words]
        # Out of reach of Ctrl-C, which would end it with a traceback.
        self._check = subprocess.Popen(command, stdout=subprocess.DEVNULL, start_new_session=True)

    def _ended_while_it_started(self) -> Optional[int]:
        """The exit code if a required node died before all were started. roslaunch's error names another."""
        monitor = self._parent.pm if self._parent is not None else None
        if monitor is None or not monitor.is_shutdown:
            return None
        # roslaunch stops its monitor first, and reports the death then.
        with contextlib.suppress(queue.Empty):
            while True:
                code = self._handle(self._events.get(timeout=DEATH_REPORT))
                if code is not None:
                    return code
        return None

    def _handle(self, event: _Event) -> Optional[int]:
        """The exit code when the event ends the run."""
        if isinstance(event, signal.Signals):
            self._say(f"{event.name}: stopping")
            return 128 + event
        assert self._parent is not None
        if event.process in self._missions and not event.again:
            self._missions[event.process] = _positive(event.exit_code)
            codes = list(self._missions.values())
            if None in codes:
                return None
            code = max(code for code in codes if code is not None)
            if code not in (0, EXIT_REFUSED):  # a mission that refused has said why
                self._say(f"the mission ended with exit code {code}{self._logs()}")
            return code
        node = self._parent.node_of(event.process)
        name = event.process.rsplit("-", 1)[0]
        if event.follows:
            how = signal_name(-(event.exit_code or 0))
            self._say(f"the wrapper of node '{name}' was killed ({how}); {event.follows}")
        if event.again:
            return None
        if self._parent.needs(node):
            self._say(f"required node '{name}' died with exit code {event.exit_code}{self._logs()}")
            return _positive(event.exit_code) or EXIT_FAILED
        if event.exit_code:
            self._say(f"node '{name}' died with exit code {event.exit_code}{self._logs()}")
        return None

    def _signalled(self, number: int, _frame: object) -> None:
        self._user_ended = True
        self._events.put(signal.Signals(number))

    def _say(self, text: str) -> None:
        self._relay.say(f"{self._command}: {text}")

    def _stop(self) -> None:
        self._relay.mute()
        if self._check is not None:
            self._check.kill()  # of the lowest priority, it may take long to end: the robot stops before
        if self._parent is not None:
            self._parent.shutdown()
        if self._check is not None:
            self._check.wait()  # else it counts among what the nodes left behind
        left: List[int] = end_children()
        if left:
            print(f"killed {len(left)} processes that their nodes left behind")
        if self._master is not None:
            self._master.stop()

    def _logs(self) -> str:
        return f"; logs: {self.log_folder}"


def _bind_nodes() -> None:
    """Has the kernel interrupt the nodes when this process is killed: its supervisor may be, too."""
    runner, begin_session = os.getpid(), os.setsid

    def begin() -> None:
        begin_session()
        if not end_with(runner, signal.SIGINT):
            os._exit(128 + signal.SIGINT)

    os.setsid = begin  # roslaunch has each of its processes call it


def _advice(error: Exception) -> str:
    """What to do when roslaunch does not reach itself; it does not name the variable that misleads it."""
    given = given_address()
    if not given or "contact my own server" not in str(error):
        return ""
    return f" {given} is not an address of this machine, it seems; correct or unset it"


def _positive(exit_code: Optional[int]) -> int:
    """An exit code as a shell shows it: a process killed by signal n ends with 128 + n."""
    if exit_code is None:
        return EXIT_FAILED
    return exit_code if exit_code >= 0 else 128 - exit_code


def main(again: bool = False, on_end: Callable[[], None] = lambda: None) -> int:
    """Runs what the command line asks for; returns the exit code.

    :param again: whether it ran before and was killed: the knowledge that it has kept stays.
    :param on_end: called when the run ends by itself, before its nodes are ended.
    """
    try:
        request = LaunchRequest.from_command_line(sys.argv[1:])
    except HelpWanted as asked:
        print(f"usage: rosrun merlin run {asked}")
        return 0
    except LaunchError as error:
        print(f"merlin run: {error}", file=sys.stderr)
        return EXIT_REFUSED
    said = use_loopback()
    if said:
        print(f"merlin run: {said}", file=sys.stderr, flush=True)
    end_lightly()
    if again:
        request.arguments.pop("reset_state", None)
    run = LaunchRun(request, on_end=on_end)
    code = run.run()
    page, user = run.page, terminal()
    if page is not None and code != EXIT_REFUSED and lingers(request.linger, user):
        keep(page, key=user)
    return code

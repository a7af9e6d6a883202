# SPDX-License-Identifier: Apache-2.0
"""The system under test: master, robot, witnesses and client, all marked, all ended together."""

import contextlib
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import uuid
from pathlib import Path
from typing import Dict, List, Optional, Tuple

from measuring.ros_process import free_port

from chaos.faults import CLIENT, MASTER, NODES
from chaos.judging.events import GONE, TRUTH, Event, EventLog
from chaos.judging.knowledge_rules import STATE_FILE
from chaos.judging.scene import SERVERS
from chaos.trials import Variant
from chaos.under_test import processes
from chaos.under_test.child import Child
from chaos.under_test.network import ADDRESSES, MIND, ROBOT, Network
from chaos.under_test.pressure import Pressure
from chaos.under_test.wall_clock import WallClocks

HERE = Path(__file__).resolve().parent
APPLICATION = HERE / "application"
#: Nodes on the robot's side of the link; the others, and the master, are on the other one.
ROBOT_SIDE = ("merlin_sim", "robot_state_publisher", "navigation", "soundplay_node", "listen", "merlin_guard")
#: s for a system to be up on a busy machine.
START_LIMIT = 90.0
#: s; a base that keeps its last command.
BASE_WITHOUT_TIMEOUT = 1e6
#: s that planning continues after the first plan, so that a fault can strike while it plans.
ANYTIME = 0.5
#: s that a planner of the campaign's own gets.
PLANNER_LIMIT = 8.0
ACTIONS = [
    "merlin_actions.actions.navigate:Navigate",
    *(f"chaos_actions:{name}" for name in ("Say", "Hear", "DriveDeaf", "DriveTouchy", "DrivePlain", "Quit")),
]
LAUNCHER = "launcher"
SMALL_DISK = "2m"
CLOCKS = "clocks"
#: The simulator whose clock can be set back and whose sensors can fall silent, in the place of the other one.
SIMULATOR = {"merlin_sim": "odd_simulator"}


class StartError(RuntimeError):
    """The system did not come up; the text says what is missing."""


class System:
    """One running system. Make it, :meth:`start` it, :meth:`stop` it, whatever happened.

    :param variant: how it is started.
    :param seed: of the simulator, and of the order of the start.
    """

    def __init__(self, variant: Variant, seed: int = 1) -> None:
        self.variant = variant
        self.log = EventLog()
        self.run = f"chaos{uuid.uuid4().hex[:8]}"
        self.nodes: List[str] = []
        self._seed = seed
        self._folder = Path(tempfile.mkdtemp(prefix=f"{self.run}_"))
        self._disk: Optional[Path] = None
        self._network: Optional[Network] = None
        self._master: Optional[subprocess.Popen[bytes]] = None
        self._children: Dict[str, Child] = {}
        self._pressure: Optional[Pressure] = None
        self._clocks: Optional[WallClocks] = None
        self._port = 0
        self._page: Tuple[str, str] = ("", "")

    @property
    def network(self) -> Network:
        """The link; only in a variant with one."""
        assert self._network is not None, "this variant has no network"
        return self._network

    @property
    def disk(self) -> Path:
        """The folder of the state file."""
        return self._disk or self._folder

    @property
    def page(self) -> Tuple[str, str]:
        """Address of the monitor's page, and the token of an operator; only in a variant with one."""
        return self._page

    @property
    def logs(self) -> Path:
        """The folder of the logs."""
        return self._folder

    def start(self) -> None:
        """Starts everything and waits until it is ready.

        :raises StartError: when it is not.
        """
        if self.variant.state_file == "full":
            self._disk = self._folder / "disk"
            self._disk.mkdir()
            subprocess.run(
                ["mount", "-t", "tmpfs", "-o", f"size={SMALL_DISK}", "tmpfs", str(self._disk)], check=True
            )
        if self.variant.network:
            position = self.log.position()
            self._network = Network(self.run, self._env(), self._folder, self.log.add)
            self._await("linked", position, "the link")
        if self.variant.time == "set":
            self._clocks = WallClocks(self._folder / CLOCKS)
            self._clocks.build()
        self._pressure = Pressure(self.run, self.log.add)
        self._start_master()
        self._launch()
        self.start_witnesses()
        self.start_client()
        self._await(TRUTH, 0, "the simulator")
        position = self.log.position()
        robots = [f"{robot}/" for robot in self.variant.robots]
        servers = [f"{robot}{name}" for robot in robots for name in ("move_base", "actions/drive")]
        self._children[CLIENT].tell(do="ready", servers=servers or [*SERVERS, "actions/navigate"])
        missing = self._await("ready", position, "the client")["missing"]
        if missing:
            raise StartError(f"not there after the start: {', '.join(missing)}; logs: {self._folder}")

    def tell_client(self, **command: object) -> None:
        """Sends the client a command."""
        self._children[CLIENT].tell(**command)

    def tell_witness(self, **command: object) -> None:
        """Sends a command to the witness of the robot's side, of the first one of several."""
        side = ROBOT if ROBOT in self._witnesses() else MIND
        self._children[f"witness_{side}"].tell(**command)

    def set_wall_clock(self, process: str, off: float) -> None:
        """Sets the clock on the wall of a node; "all": of all nodes and of the client.

        :param off: s from the right time.
        """
        assert self._clocks is not None, "this variant has no clocks that can be set"
        self._clocks.set(process, off)

    def pid(self, target: str) -> Optional[int]:
        """The process of a node, the master or the client; None when it does not run."""
        if target == MASTER:
            return self._master.pid if self._master is not None and self._master.poll() is None else None
        if target == CLIENT:
            child = self._children.get(CLIENT)
            return child.process.pid if child is not None and child.running else None
        launchers = [child.process.pid for name, child in self._children.items() if name.startswith(LAUNCHER)]
        return processes.node_pid(self.run, target, launchers)

    def usage(self) -> Dict[str, processes.Usage]:
        """What the nodes and the master hold now."""
        found = {}
        for name in [*self.nodes, MASTER]:
            pid = self.pid(name)
            held = processes.usage(pid) if pid is not None else None
            if held is not None:
                found[name] = held
        return found

    def start_master_again(self) -> None:
        """Starts a new master at the old one's port, and witnesses and a client that it knows."""
        if self._master is not None and self._master.poll() is None:
            self._master.kill()
            self._master.wait()
        self._start_master()
        self.start_witnesses()
        self.start_client()

    def start_witnesses(self) -> None:
        """Starts the witnesses, in the place of those that run."""
        for name, topics in self._witnesses().items():
            side = ROBOT if self.variant.network and name == ROBOT else MIND
            robots = self.variant.robots
            namespace = "" if topics != ROBOT or not robots else robots[0] if name == ROBOT else name
            command = [sys.executable, str(HERE / "witness.py"), topics]
            # What is seen of a further robot does not look like what is seen of the first one.
            prefix = "" if name in (ROBOT, MIND) else name
            more = {"ROS_NAMESPACE": namespace} if namespace else {}
            self._child(f"witness_{name}", side, command, more, prefix)

    def _witnesses(self) -> Dict[str, str]:
        """Names of the witnesses, and the topics of each."""
        if not (self.variant.network or self.variant.robots):
            return {MIND: "all"}
        return {ROBOT: ROBOT, MIND: MIND, **dict.fromkeys(self.variant.robots[1:], ROBOT)}

    def start_client(self) -> None:
        """Starts the client, in the place of one that runs."""
        clock = self._clocks.environment(CLIENT) if self._clocks is not None else {}
        position = self._child(CLIENT, MIND, [sys.executable, str(HERE / "pilot.py")], clock)
        self._await("up", position, "the client")

    def start_second(self, node: str) -> None:
        """Starts a second process of a node's name."""
        package, executable = {
            "merlin_executor": ("merlin_executor", "executor"),
            "merlin_bridges": ("merlin_actions", "bridges"),
        }[node]
        command = ["rosrun", package, executable, f"__name:={node}"]
        with (self._folder / f"second_{node}.out").open("ab") as output:
            subprocess.Popen(
                self._inside(MIND, command),
                env=self._env(MIND),
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    def missing_nodes(self) -> List[str]:
        """Nodes of the launch file that do not run now."""
        return [node for node in self.nodes if node in NODES and self.pid(node) is None]

    def stop(self, keep: bool = False) -> None:
        """Ends everything, at once: what a crash leaves behind does not affect the next system.

        :param keep: the folder of the logs.
        """
        self.log.close("the system was stopped")
        if self._pressure is not None:
            self._pressure.close()
        processes.kill_marked(self.run)
        for child in self._children.values():
            child.close()
        if self._master is not None:
            self._master.wait()
        if self._network is not None:
            self._network.close()
        processes.reap()
        if self._disk is not None:
            subprocess.run(["umount", "-l", str(self._disk)], check=False)
        if not keep:
            shutil.rmtree(self._folder, ignore_errors=True)

    def kill(self, reason: str) -> None:
        """Ends everything from another thread, because a trial takes too long."""
        self.log.close(reason)
        processes.kill_marked(self.run)

    # ------------------------------------------------------------------------------------------ starting

    def _start_master(self) -> None:
        # The port is probed in this namespace; in one of its own every port is free.
        self._port = self._port or free_port()
        command = self._inside(MIND, ["rosmaster", "--core", "-p", str(self._port)])
        with (self._folder / "master.out").open("ab") as output:
            self._master = subprocess.Popen(
                command,
                env=self._env(MIND),
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        address = (ADDRESSES[MIND] if self._network else "127.0.0.1", self._port)
        end = time.monotonic() + START_LIMIT
        while not self._listens(address):
            if time.monotonic() > end or self._master.poll() is not None:
                raise StartError(f"the master is not up; logs: {self._folder}")
            time.sleep(0.05)

    def _listens(self, address: Tuple[str, int]) -> bool:
        if self._network is None:
            with contextlib.suppress(OSError), socket.create_connection(address, 1.0):
                return True
            return False
        probe = f"import socket; socket.create_connection({address!r}, 1.0)"
        command = self._inside(MIND, [sys.executable, "-c", probe])
        return subprocess.run(command, capture_output=True, check=False).returncode == 0

    def _launch(self) -> None:
        if not self.variant.network:
            self.nodes = self._launcher(LAUNCHER, MIND, [])
            return
        # The parameters are the mind's; the robot's launcher only starts nodes.
        mind = self._launcher(LAUNCHER, MIND, ["--leave-out", *ROBOT_SIDE])
        robot = self._launcher(f"{LAUNCHER}_robot", ROBOT, ["--without-parameters", "--only", *ROBOT_SIDE])
        self.nodes = sorted({*mind, *robot})

    def _launcher(self, name: str, side: str, selection: List[str]) -> List[str]:
        file = APPLICATION / ("robots.launch" if self.variant.robots else "system.launch")
        command = [sys.executable, str(HERE / "launcher.py"), str(file), f"seed:={self._seed}"]
        if self.variant.page:
            command += self._page_arguments()
        if self.variant.mission:
            command.append("mission:=true")
        if self.variant.page and not self.variant.robots:
            command.append(f"history:={self._folder / 'history.sqlite'}")
        command += ["--run-id", self.run]
        command += [
            "--set",
            json.dumps(self._parameters() if "--without-parameters" not in selection else {}),
        ]
        if self.variant.shuffled:
            command += ["--shuffled", str(self._seed)]
        instead = dict(SIMULATOR)
        if self.variant.navigation:
            instead["navigation"] = self.variant.navigation
        command += ["--instead", json.dumps(instead)]
        if self._clocks is not None:
            command += ["--clocks", str(self._folder / CLOCKS)]
        position = self._child(name, side, [*command, *selection])
        nodes: List[str] = self._await("launched", position, f"the {name}")["nodes"]
        return nodes

    def _page_arguments(self) -> List[str]:
        """Arguments of the launch file for a page with an operator."""
        port, token, operators = free_port(), uuid.uuid4().hex, self._folder / "operators.yaml"
        operators.write_text(f"chaos: '{token}'\n")
        operators.chmod(0o600)
        self._page = (f"http://127.0.0.1:{port}", token)
        return [f"page_port:={port}", f"operators:={operators}"] + ["page:=true"] * (not self.variant.robots)

    def _parameters(self) -> Dict[str, object]:
        timeout = self.variant.base_timeout
        parameters: Dict[str, object] = {
            "/merlin_sim/cmd_vel_timeout": BASE_WITHOUT_TIMEOUT if timeout is None else timeout,
            "/rosplan_planner_interface/anytime": ANYTIME,
        }
        if not self.variant.robots:
            parameters["/merlin_fsm_host/actions"] = ACTIONS
        if self.variant.time != "simulated":
            parameters["/use_sim_time"] = False
            parameters["/merlin_sim/wall_time"] = True
        if self.variant.state_file:
            parameters["/rosplan_knowledge_base/state_file"] = str(self.disk / STATE_FILE)
            parameters["/rosplan_knowledge_base/reset_state"] = False
            parameters["/merlin_executor/goals_file"] = str(self.disk / "goals")
        if self.variant.planner:
            script = APPLICATION / f"{self.variant.planner}.py"
            parameters["/rosplan_planner_interface/time_limit"] = PLANNER_LIMIT
            parameters["/rosplan_planner_interface/planner_command"] = (
                f"{sys.executable} {script} DOMAIN PROBLEM"
            )
        return parameters

    def _child(
        self,
        name: str,
        side: str,
        command: List[str],
        more: Optional[Dict[str, str]] = None,
        prefix: str = "",
    ) -> int:
        """Starts a process in the place of an old one; returns the log's position before its events.

        :param more: variables of its environment.
        :param prefix: of the kinds of its events.
        """
        old = self._children.pop(name, None)
        if old is not None:
            processes.send(old.process.pid, signal.SIGKILL)
            old.close()
        position = self.log.position()
        env = {**self._env(side), **(more or {})}

        def add(event: Event) -> None:
            kind = f"{prefix}/{event.kind}" if prefix else event.kind
            self.log.add(Event(event.at, kind, event.data))

        child = Child(name, self._inside(side, command), env, self._folder, add)
        self._children[name] = child
        return position

    def _inside(self, side: str, command: List[str]) -> List[str]:
        return self._network.inside(side, command) if self._network is not None else command

    def _env(self, side: str = MIND) -> Dict[str, str]:
        env = dict(os.environ)
        env.pop("ROS_HOSTNAME", None)
        env[processes.MARK] = self.run
        env["ROS_HOME"] = str(self._folder)
        env["ROS_LOG_DIR"] = str(self._folder / "log")
        env["PYTHONPATH"] = os.pathsep.join([str(APPLICATION), env.get("PYTHONPATH", "")])
        env["PYTHONUNBUFFERED"] = "1"
        networked = self._network is not None
        env["ROS_IP"] = ADDRESSES[side] if networked else "127.0.0.1"
        env["ROS_MASTER_URI"] = f"http://{ADDRESSES[MIND] if networked else '127.0.0.1'}:{self._port}"
        return env

    def _await(self, kind: str, position: int, what: str) -> Event:
        event = self.log.wait_for(
            position,
            lambda event: event if event.kind in (kind, "failed", GONE) else None,
            time.monotonic() + START_LIMIT,
            time.monotonic,
        )
        if event is None or event.kind != kind:
            said = f"nothing within {START_LIMIT:.0f} s"
            if event is not None:
                said = event.get("error") or f"{event['child']} has ended"
            raise StartError(f"{what} is not up: {said}; logs: {self._folder}")
        return event

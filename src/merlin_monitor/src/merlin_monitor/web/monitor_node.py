# SPDX-License-Identifier: Apache-2.0
"""Node: the monitor."""

import os
import sys
from typing import Optional

import rospy

from merlin_monitor.access.tls import ServerTls, TlsError, read_tls
from merlin_monitor.access.web_access import HostNameError, WebAccess, check_lookers
from merlin_monitor.listeners.ros_system import ReplayedSystem, RosSystem
from merlin_monitor.panel_board import PanelBoard, panel_paths
from merlin_monitor.panels.control import operators_of_node, path_of_node, sentences_of_node
from merlin_monitor.state.history_store import HistoryError, HistoryStore
from merlin_monitor.state.inbox import Inbox
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_monitor.web.connections import ServerError
from merlin_monitor.web.robot_control import RobotControl
from merlin_monitor.web.web_server import WebServer
from merlin_ros.health import OK, Health, HealthReporter
from merlin_ros.node import on_master_replaced, run_node
from merlin_ros.parameters import ParameterError, flag, whole


def main() -> int:
    """Runs the node; returns the exit code."""
    return run_node("monitor", _start, HistoryError, ServerError, HostNameError)


def _start() -> None:
    host = str(rospy.get_param("~host", "127.0.0.1"))
    port = whole("~port", 8080, 0, 65535)
    open_look = flag("~open_look")
    open_stop = flag("~open_stop", True)
    limit = whole("~history_limit", 100_000, 100, 100_000_000)
    own = RosSystem()
    path = path_of_node(own, "~history")
    megabytes = whole("~history_megabytes", 500, 1, 1_000_000)
    make_folder = flag("~make_folder", True)
    history = HistoryStore(path, limit, make_folder, megabytes, session=_session()) if path else None
    state = MonitorModel(Inbox(rospy.logwarn), history)
    state.wording.sentences = sentences_of_node(own)
    ros = ReplayedSystem() if flag("~replayed") else own
    panels = PanelBoard(state, panel_paths(rospy.get_param("~panels", [])), offered=True, ros=ros)
    operators = operators_of_node(own)
    check_lookers(host, operators is not None, open_look)
    # Operators may come later; the files of a monitor that never has any stay unwritten.
    control = RobotControl(state, panels.requests) if operators is not None else None
    names = str(rospy.get_param("~allowed_hosts", "")).replace(",", " ").split()
    tls = _tls(own)
    server = WebServer(
        state,
        WebAccess(host, names, operators, open_stop, open_look=open_look),
        control,
        host,
        port,
        panels.scripts,
        tls.context if tls else None,
    )
    state.start()
    panels.start()
    server.start()
    rospy.on_shutdown(server.stop)
    rospy.on_shutdown(state.stop)
    on_master_replaced(lambda: _begin_anew(state, server))
    rospy.set_param("~address", server.address)
    HealthReporter({"page": lambda: Health(OK, f"serves {server.address}")}).start()
    if port and server.port != port:
        print(f"monitor: port {port} is taken, using {server.port}", file=sys.stderr)
    # On stderr, which `rosrun merlin run` and roslaunch pass on to the screen.
    print(f"monitor: {server.address}", file=sys.stderr, flush=True)


def _session() -> str:
    """What stays the same while the master lives, and this monitor is started again; empty: not known."""
    run = rospy.get_param("/run_id", "")
    return f"{run} {rospy.get_name()}" if run else ""


def _begin_anew(state: MonitorModel, server: WebServer) -> None:
    """Replaces the process, as the master has been replaced: nothing of the last run is shown in the next."""
    rospy.logwarn("the master was started anew: the monitor begins anew, too")
    server.stop()
    state.stop()
    # Open pages look for it at its port; as an argument, because the new master may be gone again.
    arguments = [word for word in sys.argv if not word.startswith("_port:=")]
    os.execv(sys.executable, [sys.executable, *arguments, f"_port:={server.port}"])


def _tls(ros: RosSystem) -> Optional[ServerTls]:
    try:
        tls = read_tls(path_of_node(ros, "~certificate"), path_of_node(ros, "~key"))
    except TlsError as error:
        raise ParameterError(str(error)) from error
    if tls is not None and tls.warning:
        rospy.logwarn(tls.warning)
    return tls

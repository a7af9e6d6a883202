# SPDX-License-Identifier: Apache-2.0
"""The command `rosrun merlin doctor`: what is wrong here, and what to do."""

import argparse
import os
import socket
import sys
from typing import List

import rosgraph
from rosgraph.network import parse_http_host_and_port

from merlin.doctor.findings import STATUS_TYPE, Finding, Machine, judge_graph, judge_heard, judge_machine
from merlin.doctor.machine import look_at_machine
from merlin.doctor.system import Listener, look_at_graph
from merlin.launch_request import LaunchError
from merlin.running import NothingRuns, begin_node, choose
from merlin_ros.master.master_link import ERRORS
from merlin_ros.node import end_node

EXIT_WRONG = 2
CONNECT = 2.0  # s


def main() -> int:
    """Looks and prints; returns the exit code, 2 when something is wrong."""
    parser = argparse.ArgumentParser(
        prog="rosrun merlin doctor",
        description="Looks at this computer, and at the system of ROS_MASTER_URI or of a run that lives; "
        "prints what is wrong and what to do, and changes nothing. The exit code is 2 when something is.",
    )
    parser.parse_args()
    sys.argv[1:] = []  # the arguments are not those of a node
    machine = look_at_machine()
    try:
        uri, nodes = choose(lambda names, _: [name for name in names if name != "/rosout"], "nodes")
    except NothingRuns:
        return _report([*judge_machine(machine), *([_no_master(machine)] if machine.master else ())])
    except LaunchError as error:
        return _report([*judge_machine(machine), Finding(str(error))])
    os.environ["ROS_MASTER_URI"] = uri
    print(f"looking at {len(nodes)} nodes of {uri}", flush=True)
    try:
        graph = look_at_graph()
        begin_node("merlin_doctor")
        heard = Listener(graph).listen()
    except ERRORS as error:
        return _report([*judge_machine(machine), Finding(f"the master at {uri} answers no longer: {error}")])
    end_node("looked")
    return _report(
        [
            *judge_machine(machine, graph.planner_command),
            *judge_graph(graph),
            *judge_heard(heard, graph.of_type(STATUS_TYPE)),
        ]
    )


def _no_master(machine: Machine) -> Finding:
    """Why nothing but the machine was looked at."""
    uri = rosgraph.get_master_uri()
    try:
        with socket.create_connection(parse_http_host_and_port(uri), CONNECT):
            return Finding(
                f"the master at {uri} takes connections and knows no node, or hangs; start it anew"
            )
    except (OSError, UnicodeError) as error:
        if machine.master_is_elsewhere:
            return Finding(
                f"the master at {uri} cannot be reached ({error}); correct ROS_MASTER_URI, or start it"
            )
    return Finding("nothing runs: only the computer was looked at", wrong=False)


def _report(findings: List[Finding]) -> int:
    """Prints what is wrong first; returns the exit code."""
    for finding in sorted(findings, key=lambda each: not each.wrong):
        print(f"{'wrong' if finding.wrong else 'note'}: {finding.text}", flush=True)
    wrong = sum(finding.wrong for finding in findings)
    print(f"{wrong} wrong" if wrong else "nothing is wrong", flush=True)
    return EXIT_WRONG if wrong else 0

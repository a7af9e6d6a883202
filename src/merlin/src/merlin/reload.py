# SPDX-License-Identifier: Apache-2.0
"""The command `rosrun merlin reload`: takes edited actions in, while the rest of the system continues."""

import os
import sys
from typing import List

import rospy
from std_srvs.srv import Trigger

from merlin.launch_request import LaunchError
from merlin.running import choose
from merlin_ros.node import init_node
from merlin_ros.service_proxy import ServiceError, ServiceProxy

SERVICE = "/reload_actions"
EXIT_MISTAKES = 2
LIMIT = 60.0  # s of wall time: the classes' modules are imported and checked
USAGE = "usage: rosrun merlin reload [node of the actions …]"


def main() -> int:
    """Reloads the actions of all hosts, or of those named.

    :return: exit code, 2 when nothing was reloaded.
    """
    hosts = sys.argv[1:]
    if any(word.startswith("-") for word in hosts):
        print(USAGE)
        return 0 if {"-h", "--help"} & set(hosts) else EXIT_MISTAKES
    try:
        uri, services = choose(lambda nodes, there: wanted(there, hosts), "actions that can be reloaded")
    except LaunchError as error:
        print(f"merlin reload: {error}", file=sys.stderr)
        return EXIT_MISTAKES
    os.environ["ROS_MASTER_URI"] = uri
    sys.argv[1:] = []  # the arguments are not those of a node
    init_node("merlin_reload", anonymous=True)
    try:
        return max(_reload(service) for service in services)
    finally:
        rospy.signal_shutdown("reloaded")


def wanted(services: List[str], hosts: List[str]) -> List[str]:
    """The services that reload actions.

    :param hosts: names of their nodes; none: all of them.
    """
    found = [name for name in services if name.endswith(SERVICE)]
    named = {f"/{host.strip('/')}{SERVICE}" for host in hosts}
    return [name for name in found if name in named] if hosts else found


def _reload(service: str) -> int:
    host = service[: -len(SERVICE)].strip("/")
    try:
        answer = ServiceProxy(service, Trigger, LIMIT)()
    except ServiceError as error:
        print(f"merlin reload: {host}: {error}", file=sys.stderr)
        return EXIT_MISTAKES
    if answer.success:
        print(f"{host}: {answer.message}")
        return 0
    print(f"{host}: the actions stay as they were: {answer.message}", file=sys.stderr)
    return EXIT_MISTAKES

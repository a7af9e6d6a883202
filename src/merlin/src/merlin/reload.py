# SPDX-License-Identifier: Apache-2.0
"""The command `rosrun merlin reload`: takes edited actions in, while the rest of the system continues."""

import sys
from typing import List

from std_srvs.srv import Trigger

from merlin.launch_request import LaunchError
from merlin.running import EXIT_REFUSED, beside
from merlin_ros.service_proxy import ServiceError, ServiceProxy

SERVICE = "/reload_actions"
LIMIT = 60.0  # s of wall time: the classes' modules are imported and checked
USAGE = "usage: rosrun merlin reload [node of the actions …]"


def main() -> int:
    """Reloads the actions of all hosts, or of those named.

    :return: exit code, 2 when nothing was reloaded.
    """
    hosts = sys.argv[1:]
    if any(word.startswith("-") for word in hosts):
        print(USAGE)
        return 0 if {"-h", "--help"} & set(hosts) else EXIT_REFUSED
    return beside(
        "merlin reload",
        lambda nodes, services: wanted(services, hosts),
        "actions that can be reloaded",
        lambda services: _reload_all(services, hosts),
    )


def wanted(services: List[str], hosts: List[str]) -> List[str]:
    """The services that reload actions.

    :param hosts: names of their nodes; none: all of them.
    """
    found = [name for name in services if name.endswith(SERVICE)]
    named = set(map(_service, hosts))
    return [name for name in found if name in named] if hosts else found


def _service(host: str) -> str:
    return f"/{host.strip('/')}{SERVICE}"


def _reload_all(services: List[str], hosts: List[str]) -> int:
    missing = [host for host in hosts if _service(host) not in services]
    if missing:
        raise LaunchError(f"not there, or without actions: {', '.join(missing)}; nothing was reloaded")
    return max(map(_reload, services))


def _reload(service: str) -> int:
    host = service[: -len(SERVICE)].strip("/")
    try:
        answer = ServiceProxy(service, Trigger, LIMIT)()
    except ServiceError as error:
        print(f"merlin reload: {host}: {error}", file=sys.stderr)
        return EXIT_REFUSED
    if answer.success:
        print(f"{host}: {answer.message}")
        return 0
    print(f"{host}: the actions stay as they were: {answer.message}", file=sys.stderr)
    return EXIT_REFUSED

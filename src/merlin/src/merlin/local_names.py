# SPDX-License-Identifier: Apache-2.0
"""Lets a system on one machine run when the machine's names cannot be resolved: it uses 127.0.0.1.

In containers, `/etc/hosts` may lack the machine's own name or `localhost`. ROS puts both into addresses.
"""

import os
import socket
import sys
from typing import List

LOOPBACK = "127.0.0.1"
LOCALHOST = "localhost"
#: roslaunch asks for the address of localhost before it starts a node, and two processes for the version of
#: ROS. Its arguments: an address, the tool.
_TOOL = (
    "from merlin_ros.lean_start import end_lightly, prepare\n"
    "prepare()\n"
    "import sys, roslaunch, roslaunch.core, roslaunch.xmlloader, rostest\n"
    "from merlin.launch_config import Loader\n"
    "roslaunch.xmlloader.XmlLoader = Loader\n"
    "end_lightly()\n"
    "roslaunch.core.local_machine().address = sys.argv[1]\n"
    "del sys.argv[:2]\n"
    "sys.exit({'roslaunch': roslaunch.main, 'rostest': rostest.rostestmain}[sys.argv[0]]())\n"
)


def resolves(name: str) -> bool:
    """Whether a name has an address."""
    try:
        return bool(socket.getaddrinfo(name, None))
    except (OSError, UnicodeError):
        return False


def is_own(name: str) -> bool:
    """Whether a name or address leads to this computer; one that cannot be resolved does not."""
    try:
        found = socket.getaddrinfo(name, 0, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError):
        return False
    for family, kind, _, _, address in found:
        try:
            with socket.socket(family, kind) as probe:
                probe.bind(address)  # the kernel takes its own addresses only
                return True
        except OSError:
            continue
    return False


def given_address() -> str:
    """The variable in which the user gives the address of this machine, as NAME=value; empty: none is set."""
    for name in ("ROS_HOSTNAME", "ROS_IP"):  # in the order in which ROS looks
        if os.environ.get(name):
            return f"{name}={os.environ[name]}"
    return ""


def use_loopback() -> str:
    """Makes this process and its children use 127.0.0.1 when the host name has no address.

    What the user has set, ROS_IP or ROS_HOSTNAME, stays.

    :return: a sentence for the user; empty when all names have addresses.
    """
    missing = [] if resolves(LOCALHOST) else [f"{LOOPBACK} {LOCALHOST}"]
    name = socket.gethostname()
    if not given_address() and not resolves(name):
        os.environ["ROS_IP"] = LOOPBACK
        if name != LOCALHOST:
            missing.append(f"127.0.1.1 {name}")
    if not missing:
        return ""
    names = " and ".join(repr(line.split()[1]) for line in missing)
    lines = ", and the line ".join(f"'{line}'" for line in missing)
    needs = f"plain roslaunch needs the line {lines} in /etc/hosts"
    return f"{names} cannot be resolved, {LOOPBACK} is used; {needs}"


def master_uri(port: int) -> str:
    """The address of a master on this machine."""
    return f"http://{LOCALHOST if resolves(LOCALHOST) else LOOPBACK}:{port}"


def launch_tool(name: str) -> List[str]:
    """The command `roslaunch` or `rostest`, which starts nodes although localhost has no address."""
    address = LOCALHOST if resolves(LOCALHOST) else LOOPBACK
    return [sys.executable, "-c", _TOOL, address, name]

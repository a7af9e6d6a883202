# SPDX-License-Identifier: Apache-2.0
"""Threads and memory of the nodes on a master."""

import xmlrpc.client
from typing import Any, Dict

import rosgraph
import rosnode

from stress.process_status import Usage, usage_of


def pid_of(node: str) -> int:
    """Process id of a node.

    :param node: global name.
    :raises OSError: when it does not answer.
    :raises rosgraph.MasterException: when the master does not know it.
    """
    master: Any = rosgraph.Master("/process_usage")
    proxy: Any = xmlrpc.client.ServerProxy(master.lookupNode(node))
    return int(proxy.getPid("/process_usage")[2])


def usage_of_nodes() -> Dict[str, Usage]:
    """Threads and resident memory of every node of this machine that answers."""
    usage: Dict[str, Usage] = {}
    for name in rosnode.get_node_names():
        try:
            usage[name] = usage_of(pid_of(name))
        except (OSError, rosgraph.MasterException, xmlrpc.client.Error):
            continue
    return usage

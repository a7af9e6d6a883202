# SPDX-License-Identifier: Apache-2.0
"""Threads and memory of the nodes on a master."""

import xmlrpc.client
from typing import Any, Dict

import rosgraph
import rosnode

from stress.process_status import Usage, usage_of


def usage_of_nodes() -> Dict[str, Usage]:
    """Threads and resident memory of every node of this machine that answers."""
    master = rosgraph.Master("/process_usage")
    usage: Dict[str, Usage] = {}
    for name in rosnode.get_node_names():
        try:
            uri = master.lookupNode(name)
            answer: Any = xmlrpc.client.ServerProxy(uri).getPid("/process_usage")
            usage[name] = usage_of(answer[2])
        except (OSError, rosgraph.MasterException, xmlrpc.client.Error):
            continue
    return usage

"""Threads and memory of the nodes on a master."""

import xmlrpc.client
from pathlib import Path
from typing import Any, Dict, NamedTuple

import rosgraph
import rosnode


class Usage(NamedTuple):
    """What a node's process holds."""

    threads: int
    memory_mb: float


def usage_of_nodes() -> Dict[str, Usage]:
    """Threads and resident memory of every node of this machine that answers."""
    master = rosgraph.Master("/process_usage")
    usage: Dict[str, Usage] = {}
    for name in rosnode.get_node_names():
        try:
            uri = master.lookupNode(name)
            answer: Any = xmlrpc.client.ServerProxy(uri).getPid("/process_usage")
            lines = Path(f"/proc/{answer[2]}/status").read_text().splitlines()
        except (OSError, rosgraph.MasterException, xmlrpc.client.Error):
            continue
        fields = dict(line.split(":", 1) for line in lines if ":" in line)
        memory = float(fields.get("VmRSS", "0").split()[0]) / 1024
        usage[name] = Usage(int(fields["Threads"]), memory)
    return usage

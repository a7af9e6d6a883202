# SPDX-License-Identifier: Apache-2.0
"""Where the executables of packages are, and how nodes of tests start, for tests that start many nodes."""

import functools
import sys
from typing import List

#: Begins the source of a node, which then starts as lean as those of MERLIN.
LEAN = (
    "import gc; gc.set_threshold(50_000)\n"  # Python looks through all that is imported less often
    "from merlin_ros.lean_start import prepare; prepare()\n"
    # A call to a node that has ended comes to whatever has its port now. rospy alone would wait for its end.
    "from merlin_ros.ports.tcpros_port import use_entrance; use_entrance()\n"
)


def lean_script(path: object, *arguments: str) -> List[str]:
    """The command that runs a script of the tests as lean as a node of MERLIN starts."""
    return [sys.executable, "-m", "merlin_test", str(path), *arguments]


@functools.lru_cache(maxsize=None)
def node_path(package: str, executable: str) -> str:
    """The file that `rosrun` would start.

    `rosrun` looks for it in a Python process of its own, each time, which costs as much as a node's start.

    :raises AssertionError: there is none.
    """
    import roslib.packages  # which processes that are started do without

    found = roslib.packages.find_node(package, executable)  # that of the devel space, then its source
    assert found, f"{package} has no {executable}"
    return str(found[0])

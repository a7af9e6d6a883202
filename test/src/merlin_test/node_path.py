# SPDX-License-Identifier: Apache-2.0
"""Where the executables of packages are, for tests that start many nodes."""

import functools

import roslib.packages


@functools.lru_cache(maxsize=None)
def node_path(package: str, executable: str) -> str:
    """The file that `rosrun` would start.

    `rosrun` looks for it in a Python process of its own, each time, which costs as much as a node's start.

    :raises AssertionError: there is none.
    """
    found = roslib.packages.find_node(package, executable)  # that of the devel space, then its source
    assert found, f"{package} has no {executable}"
    return str(found[0])

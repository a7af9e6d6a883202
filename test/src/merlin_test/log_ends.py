# SPDX-License-Identifier: Apache-2.0
"""What the nodes of a run that failed have logged last."""

import re
from pathlib import Path
from typing import Iterator

#: A node logs its connections and each call of its slave API.
OF_ROSPY = re.compile(r"\[(rosmaster|rospy|roslaunch|xmlrpc)\S*\]\[INFO\]")
#: Lines of each node.
LINES = 12


def ends_of_logs(folder: Path) -> Iterator[str]:
    """Lines of the run that began last, with the name of each log before them.

    :param folder: that of ROS_LOG_DIR.
    """
    for log in sorted(folder.glob("latest/*.log")):
        lines = log.read_text(encoding="utf-8", errors="replace").splitlines()
        said = [line for line in lines if not OF_ROSPY.match(line)]
        if said:
            yield f"--- {log.name}"
            yield from said[-LINES:]

# SPDX-License-Identifier: Apache-2.0
"""What is said of a test that fails: its case, as rosunit has no subTest, and what nodes have logged last."""

import contextlib
import re
from pathlib import Path
from typing import Any, Iterator

#: A node logs its connections and each call of its slave API.
OF_ROSPY = re.compile(r"\[(rosmaster|rospy|roslaunch|xmlrpc)\S*\]\[INFO\]")
#: Lines of each node.
LINES = 12


@contextlib.contextmanager
def named_case(*what: Any) -> Iterator[None]:
    """Puts what is tried before the text of an assertion that fails within it."""
    try:
        yield
    except AssertionError as error:
        raise AssertionError(f"{', '.join(map(str, what))}: {error}") from error


def ends_of_logs(folder: Path) -> Iterator[str]:
    """Lines of the run that began last, with the name of each log before them.

    :param folder: that of ROS_LOG_DIR.
    """
    for log in sorted(folder.glob("latest/*.log")):
        lines = log.read_text(encoding="utf-8", errors="replace").splitlines()
        said = [line for line in lines if not OF_ROSPY.match(line)]
        yield f"--- {log.name}" + ("" if said else ": it logged nothing")
        yield from said[-LINES:]

# SPDX-License-Identifier: Apache-2.0
"""The page of a run that has ended, kept for a look at it: `linger:=` of `rosrun merlin run`."""

import os
import sys
from enum import Enum
from pathlib import Path
from typing import Any, Dict, Iterable, NamedTuple, Optional

from roslaunch.core import Node

MONITOR = ("merlin_monitor", "monitor")
NO_FILE = ("", "none")


class Linger(Enum):
    """Whether the page stays when the run has ended."""

    NEVER = "false"
    ALWAYS = "true"
    ON_TERMINAL = "auto"


class Page(NamedTuple):
    """What a run leaves of its page.

    :ivar history: the monitor's file.
    :ivar host: address on which the monitor served.
    :ivar port: that it was asked to serve on.
    """

    history: Path
    host: str
    port: int

    def written_since(self, wall: float) -> bool:
        """Whether the file is that of a run, and not only of one before.

        :param wall: when the run began, s since 1970.
        """
        files = self.history.parent.glob(f"{self.history.name}*")  # SQLite may leave its log beside it
        return any(file.stat().st_mtime >= wall for file in files)


def page_of(nodes: Iterable[Node], parameters: Dict[str, Any]) -> Optional[Page]:
    """The page of the first monitor that keeps a history.

    :param nodes: of the launch file.
    :param parameters: name → value.
    """
    for node in nodes:
        own = f"{node.namespace}{node.name}/"
        history = str(parameters.get(f"{own}history", ""))
        if (node.package, node.type) == MONITOR and history not in NO_FILE:
            host, port = str(parameters.get(f"{own}host", "127.0.0.1")), parameters.get(f"{own}port", 8080)
            if isinstance(port, int):  # else the monitor says why
                return Page(Path(history).expanduser(), host, port)
            return None
    return None


def lingers(linger: Linger, on_terminal: bool) -> bool:
    """Whether the page of a run is kept.

    :param on_terminal: whether a user can end it with a key.
    """
    return linger is Linger.ALWAYS or (linger is Linger.ON_TERMINAL and on_terminal)


def terminal() -> bool:
    """Whether this process talks with a user: in the foreground of a terminal, with its output on it."""
    try:
        return os.isatty(1) and os.tcgetpgrp(0) == os.getpgrp()
    except OSError:  # the input is closed, no terminal, or that of another session
        return False


def keep(page: Page, key: bool) -> None:
    """Serves the page of the past until a signal that ends processes.

    :param key: whether a key ends it, too.
    """
    # A web server is much to import for a run that does not linger.
    from merlin_monitor.history.history_file import HistoryError
    from merlin_monitor.web.connections import ServerError
    from merlin_monitor.web.open_command import opened, wait_for_end

    try:
        with opened(page.history, page.host, page.port) as server:
            ends = "a key or Ctrl-C ends it" if key else "Ctrl-C ends it"
            print(f"merlin run: the page of this run stays: {server.address}  ({ends})", file=sys.stderr)
            wait_for_end(key)
    except (HistoryError, ServerError) as error:
        print(f"merlin run: the page of this run cannot be kept: {error}", file=sys.stderr)
    except KeyboardInterrupt:
        pass  # before the page stood, or when it had ended: all that is left is to end

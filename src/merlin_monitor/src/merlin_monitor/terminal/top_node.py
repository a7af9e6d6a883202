# SPDX-License-Identifier: Apache-2.0
"""``rosrun merlin_monitor top``: the state in a terminal. q quits; without a terminal it prints once."""

import contextlib
import os
import select
import shutil
import sys
import termios
import threading
import time
import tty
from collections import deque
from typing import Any, Deque, Iterator, List

import rosgraph
import rospy

from merlin_monitor.listeners.ros_system import RosSystem
from merlin_monitor.panel_board import PanelBoard
from merlin_monitor.panels.control import sentences_of_node
from merlin_monitor.state.history_events import Event
from merlin_monitor.state.inbox import Inbox
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_monitor.terminal.terminal_view import lines, paint
from merlin_ros.master.master_link import master_fault
from merlin_ros.node import init_node, print_help

REDRAW = 0.2  # s between two pictures
LISTEN = 4.0  # s of wall time that are listened to before the state is printed once
QUIET = 0.8  # s without a change after which it is printed at once
KEEP = 50  # events
CLEAR, HOME, REST = "\x1b[2J", "\x1b[H", "\x1b[J"
HIDE, SHOW = "\x1b[?1049h\x1b[?25l", "\x1b[?25h\x1b[?1049l"


class Terminal:
    """Draws the state again and again, or once.

    :param state: the model.
    """

    def __init__(self, state: MonitorModel) -> None:
        self._state = state
        self._events: Deque[Event] = deque(maxlen=KEEP)
        self._changed = threading.Event()
        self._began = time.monotonic()
        self._feed = state.tree.subscribe(self._changed.set)

    def report(self, event: Event) -> None:
        """Keeps an event until the next print; from any thread."""
        self._events.append(event)

    def print_once(self) -> None:
        """Prints what is known after a while of listening."""
        end = time.monotonic() + LISTEN
        while time.monotonic() < end and not rospy.is_shutdown():
            self._feed.take()
            self._changed.clear()
            if not self._changed.wait(QUIET) and self._state.tree.keys("knowledge", "objects"):
                break
        for line in self._paint(200, 10_000, colour=False):
            print(line)

    def run(self) -> None:
        """Draws until q is pressed or ROS shuts down."""
        with _screen() as keys:
            while not rospy.is_shutdown():
                size = shutil.get_terminal_size()
                picture = self._paint(size.columns, size.lines - 1, "NO_COLOR" not in os.environ)
                sys.stdout.write(HOME + "\x1b[K\r\n".join(picture) + "\x1b[K" + REST)
                sys.stdout.flush()
                ready, _, _ = select.select([keys], [], [], REDRAW)
                if ready and os.read(keys, 64) in (b"q", b"Q", b"\x03", b"\x1b", b""):
                    return

    def _paint(self, width: int, height: int, colour: bool) -> List[str]:
        self._feed.take()
        _, state = self._state.tree.snapshot()
        silence = time.monotonic() - max(self._began, self._state.checked_at)
        return paint(lines(state, list(self._events), silence), width, height, colour)


@contextlib.contextmanager
def _screen() -> Iterator[Any]:
    keys = sys.stdin.fileno()
    before = termios.tcgetattr(keys)
    try:
        tty.setcbreak(keys)
        sys.stdout.write(HIDE + CLEAR)
        yield keys
    finally:
        termios.tcsetattr(keys, termios.TCSADRAIN, before)
        sys.stdout.write(SHOW)
        sys.stdout.flush()


def main() -> int:
    """Entry point; returns the exit code."""
    print_help()
    fault = master_fault()
    if fault:
        uri = rosgraph.get_master_uri()
        print(
            f"top: no ROS master answers at {uri}: {fault}; set ROS_MASTER_URI, or start something",
            file=sys.stderr,
        )
        return 1
    init_node("merlin_top", anonymous=True)
    # The screen belongs to the picture: warnings about messages are not printed into it.
    state = MonitorModel(Inbox(rospy.logdebug))
    terminal = Terminal(state)
    state.on_event = terminal.report
    state.wording.sentences = sentences_of_node(RosSystem(), needed=False)
    panels = PanelBoard(state)
    state.start()
    panels.start()
    if sys.stdin.isatty() and sys.stdout.isatty():
        terminal.run()
    else:
        terminal.print_once()
    rospy.signal_shutdown("the terminal view has ended")
    state.stop()
    return 0

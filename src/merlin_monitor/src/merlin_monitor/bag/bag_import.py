# SPDX-License-Identifier: Apache-2.0
"""Makes a history of a bag: its messages go through the panels, as a robot's do, at their own times."""

import concurrent.futures
import sqlite3
import sys
from pathlib import Path
from typing import Callable, List

from merlin_monitor.bag.recorded_system import RecordedSystem
from merlin_monitor.bag.recording import BagRecording
from merlin_monitor.history.history_file import HistoryError
from merlin_monitor.listeners.ros_system import RosSystem
from merlin_monitor.panel_board import OFFERED, PanelBoard, foreign_panel, script_of
from merlin_monitor.panels.control import sentences_of_node
from merlin_monitor.state.inbox import DirectInbox
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_ros.parameters import ParameterError

STEP = 0.2  # s between two looks at what is shown, as when a robot is recorded
QUIET = 150.0  # s without a message, after which nothing changes any more
SETTLE = 500  # messages and looks, after which the disk is waited for
DISK = 60.0  # s
NO_LIMIT = 100_000_000  # events, and megabytes: nothing of a bag is forgotten


class RecordedModel(MonitorModel):
    """A model of which the caller is the only thread, but for the file's.

    :param file: of the history.
    :param clock: s since 1970.
    :param complain: takes a line about a message that cannot be shown.
    :param session: see :class:`MonitorModel`.
    :raises HistoryError: the file cannot be used.
    """

    def __init__(
        self, file: Path, clock: Callable[[], float], complain: Callable[[str], None], session: str = ""
    ) -> None:
        inbox = DirectInbox(complain)
        super().__init__(inbox, file, NO_LIMIT, megabytes=NO_LIMIT, clock=clock, session=session)

    def start(self) -> None:
        """Begins to record."""
        assert self.history is not None
        self.tree.set("meta", "run", self.history.run)
        self._recorder.follow()

    def record(self) -> None:
        """Draws what waits to be drawn, and keeps what is shown now."""
        self._layouts.draw_waiting()
        self._recorder.take()

    def settle(self) -> None:
        """Waits until all is on the disk.

        :raises HistoryError: it cannot be written.
        """
        assert self.history is not None
        trouble = ""
        try:
            self.history.page(limit=1).result(DISK)
        except (sqlite3.Error, concurrent.futures.TimeoutError) as error:
            trouble = str(error) or f"no answer within {DISK:.0f} s"
        trouble = self.history.trouble or trouble
        if trouble:
            raise HistoryError(f"{self.history.path} cannot be written: {trouble}")

    def stop(self) -> None:
        """Closes the file."""
        assert self.history is not None
        self.history.close()


class BagImport:
    """Writes the history of a recording.

    :param recording: of `record:=true`.
    :param file: is made.
    :param progress: called again and again, with 0 to 1.
    :param complain: takes lines about what cannot be shown.
    :raises RecordingError: the bag is damaged.
    :raises HistoryError: the file cannot be used.
    """

    def __init__(
        self,
        recording: BagRecording,
        file: Path,
        progress: Callable[[float], object] = lambda part: None,
        complain: Callable[[str], None] = lambda line: print(line, file=sys.stderr),
    ) -> None:
        self._recording = recording
        self._progress = progress
        self._ros = RecordedSystem(recording)
        self._model = RecordedModel(file, self._ros.wall, complain)
        self._model.wording.sentences = sentences_of_node(self._ros, needed=False)
        try:
            self._board = PanelBoard(self._model, usable_panels(self._ros, complain), ros=self._ros)
        except BaseException:
            self._model.stop()
            raise
        self._wall = self._ros.clock.begin  # up to which it is shown
        self._unsettled = 0

    def run(self) -> None:
        """Reads the bag to its end.

        :raises RecordingError: it is damaged.
        :raises HistoryError: the file cannot be written.
        """
        clock = self._ros.clock
        try:
            self._model.start()
            self._board.look()
            for message in self._recording.messages():
                self._show_until(clock.wall(message.at.to_sec()))
                self._ros.deliver(message)
                self._note()
            self._model.tree.set(
                "meta", "time", self._recording.end
            )  # also when nothing else changes any more
            self._show(max(self._wall, clock.end))
            self._model.settle()
        finally:
            self._model.stop()

    def _show_until(self, wall: float) -> None:
        heard = self._wall
        while wall - self._wall >= STEP:
            quiet = self._wall - heard > QUIET
            self._show(wall if quiet else self._wall + STEP)

    def _show(self, wall: float) -> None:
        self._wall = wall
        self._ros.go_to(wall)
        self._board.beat()
        self._model.record()
        self._note()

    def _note(self) -> None:
        self._unsettled += 1
        if self._unsettled >= SETTLE:
            self._unsettled = 0
            self._model.settle()
            clock = self._ros.clock
            self._progress((self._wall - clock.begin) / max(clock.end - clock.begin, STEP))


def usable_panels(ros: RosSystem, complain: Callable[[str], None]) -> List[str]:
    """The panels of applications that the monitor of then had, without those that are not here."""
    found: List[str] = []
    offered = ros.parameter(OFFERED, {})
    for path in dict.fromkeys([*ros.parameter("~panels", []), *offered.values()]):
        try:
            script_of(foreign_panel(str(path)))
        except ParameterError as error:
            complain(f"a panel is left out: {error}")
        else:
            found.append(str(path))
    return found

# SPDX-License-Identifier: Apache-2.0
"""Makes a history of a bag: where the file is, the progress, and the clean-up."""

import contextlib
import os
import signal
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, Iterator, Optional

from merlin_monitor.bag.recorded_topics import BAG
from merlin_monitor.history.history_file import FILE

_BEGIN = b"#ROSBAG V"
_ENDINGS = (".bag", ".active")
_SIDE_FILES = ("", "-wal", "-shm")
NO_MASTER = "http://localhost:1"  # nothing serves there
LINES = 10.0  # s between two lines of progress where there is no terminal
REDRAWN = 0.2  # s on a terminal


class BagError(RuntimeError):
    """A bag cannot be opened; the text is one line that says why."""


def as_bag(path: Path) -> Optional[Path]:
    """The bag that a path means; None: a history.

    :param path: a file, or a folder; in that a history comes first.
    """
    if path.is_dir():
        bags = [path / BAG, path / f"{BAG}.active"]
        return next((bag for bag in bags if not (path / FILE).is_file() and bag.is_file()), None)
    if path.suffix in _ENDINGS:
        return path
    with contextlib.suppress(OSError), path.open("rb") as file:
        return path if file.read(len(_BEGIN)) == _BEGIN else None
    return None


@contextlib.contextmanager
def history_of(bag: Path, folder: Optional[Path]) -> Iterator[Path]:
    """Makes the history of a bag.

    :param folder: for the file; None: one that is removed at the end.
    :raises BagError: the bag cannot be shown, or the folder cannot be used.
    :raises HistoryError: the file cannot be written.
    """
    with contextlib.ExitStack() as ends:
        if folder is None:
            folder = Path(ends.enter_context(tempfile.TemporaryDirectory(prefix="merlin-open-")))
        file = folder / FILE
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            reason = error.strerror or error
            raise BagError(f"the folder {folder} cannot be used: {reason}; name another one") from error
        if file.exists():
            raise BagError(f"there is a history {file} already; name another folder, or open that one")
        try:
            with _ended_by_signals():
                _import(bag, file)
        except BaseException:  # also Ctrl-C: half a history would look like a whole one
            for ending in _SIDE_FILES:
                with contextlib.suppress(OSError):
                    file.with_name(file.name + ending).unlink()
            raise
        yield file


def _import(bag: Path, file: Path) -> None:
    # Panels of applications may ask a master: not that of a robot which runs beside.
    os.environ["ROS_MASTER_URI"] = NO_MASTER
    # What reads bags takes a second to load, which a history does not need.
    from merlin_monitor.bag.bag_import import BagImport
    from merlin_monitor.bag.recording import BagRecording, RecordingError

    progress = _Progress(bag)
    try:
        recording = BagRecording(bag)
        progress.length = recording.length
        BagImport(recording, file, progress, lambda line: print(f"open: {line}", file=sys.stderr)).run()
    except RecordingError as error:
        raise BagError(str(error)) from error
    finally:
        progress.end()


class _Progress:
    """How far it is, on stderr: one line that is redrawn on a terminal, else a line now and then."""

    def __init__(self, bag: Path) -> None:
        self._bag = bag
        self.length = 0.0  # s
        self._terminal = sys.stderr.isatty()
        self._printed = time.monotonic()
        self._open = False

    def __call__(self, part: float) -> None:
        """Prints the progress, at most every few seconds.

        :param part: 0 to 1.
        """
        now = time.monotonic()
        if now - self._printed < (REDRAWN if self._terminal else LINES):
            return
        self._printed = now
        line = f"reading {self._bag}: {100 * part:.0f} % of {self.length / 60:.1f} min"
        print(f"\r{line}  " if self._terminal else line, end="" if self._terminal else "\n", file=sys.stderr)
        sys.stderr.flush()
        self._open = self._terminal

    def end(self) -> None:
        """Ends the line of the terminal on which the progress stands."""
        if self._open:
            print(file=sys.stderr)


@contextlib.contextmanager
def _ended_by_signals() -> Iterator[None]:
    """SIGTERM and SIGHUP tidy up, too, as Ctrl-C does."""

    def end(number: int, frame: Any) -> None:
        raise SystemExit(128 + number)

    before = {number: signal.signal(number, end) for number in (signal.SIGTERM, signal.SIGHUP)}
    before[signal.SIGINT] = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)

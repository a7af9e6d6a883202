# SPDX-License-Identifier: Apache-2.0
"""``rosrun merlin_monitor open``: the page of a run that has ended, or of a bag. No node, no master."""

import argparse
import concurrent.futures
import contextlib
import os
import re
import select
import signal
import sys
import tempfile
import termios
import time
import tty
from pathlib import Path
from typing import Any, Callable, Dict, Iterable, Iterator, List, Optional, Sequence

from merlin_monitor.access.operators import Operators, OperatorsError, default_path
from merlin_monitor.access.web_access import HostNameError, WebAccess, is_loopback
from merlin_monitor.bag import BAG
from merlin_monitor.history.history_file import FILE, SIDE_FILES, HistoryError
from merlin_monitor.history.history_reader import HistoryReader
from merlin_monitor.history.pictures import Pictures
from merlin_monitor.panel_scripts import script_file
from merlin_monitor.state.history_events import Event
from merlin_monitor.state.history_store import NEWEST, HistorySection, last_state
from merlin_monitor.state.state_tree import StateTree
from merlin_monitor.web.connections import ServerError
from merlin_monitor.web.web_server import WebServer
from merlin_ros.processes.tidy_end import TIDY, handled

_BEGIN = b"#ROSBAG V"
_ENDINGS = (".bag", ".active")
NO_MASTER = "http://localhost:1"  # nothing serves there
LINES = 10.0  # s between two lines of progress where there is no terminal
REDRAWN = 0.2  # s on a terminal


class BagError(RuntimeError):
    """A bag cannot be opened; the text is one line that says why."""


def as_bag(path: Path) -> Optional[Path]:
    """The bag that a path means; None: a history.

    :param path: a file, or a folder; in that a history comes first.
    """
    if os.path.isdir(path):  # pathlib raises where this user may not look
        bags = [path / BAG, path / f"{BAG}.active"]
        return next((bag for bag in bags if not os.path.isfile(path / FILE) and os.path.isfile(bag)), None)
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
            with handled(TIDY):
                _import(bag, file)
        except BaseException:  # also Ctrl-C: half a history would look like a whole one
            for ending in SIDE_FILES:
                with contextlib.suppress(OSError):
                    file.with_name(file.name + ending).unlink()
            raise
        yield file


def _import(bag: Path, file: Path) -> None:
    # Panels of applications may ask a master: not that of a robot which runs beside.
    os.environ["ROS_MASTER_URI"] = NO_MASTER
    # What reads bags takes a second to load, which a history does not need.
    from merlin_monitor.bag.bag_import import import_bag
    from merlin_monitor.bag.recording import BagRecording, RecordingError

    try:
        recording = BagRecording(bag)
        with _progress(bag, recording.length / 60) as progress:
            import_bag(recording, file, progress, lambda line: print(f"open: {line}", file=sys.stderr))
    except RecordingError as error:
        raise BagError(str(error)) from error


@contextlib.contextmanager
def _progress(bag: Path, minutes: float) -> Iterator[Callable[[float], None]]:
    """Says how far it is, 0 to 1: on a terminal in one line that is redrawn, else in a line now and then."""
    terminal = sys.stderr.isatty()
    began = said = time.monotonic()
    begin, end = ("\r", "  ") if terminal else ("", "\n")

    def say(part: float) -> None:
        nonlocal said
        if time.monotonic() - said >= (REDRAWN if terminal else LINES):
            said = time.monotonic()
            line = f"{begin}reading {bag}: {100 * part:.0f} % of {minutes:.1f} min"
            print(line, end=end, file=sys.stderr, flush=True)

    try:
        yield say
    finally:
        if terminal and said > began:
            print(file=sys.stderr)


STARTUP = 60.0  # s for each of the first answers
_NAME = re.compile(r"[a-z][a-z0-9_]{0,40}\Z")


class Archive:
    """The model that the web server shows for a history, in place of a MonitorModel.

    :param path: the file, or the folder in which it is.
    :param name: what the page calls it.
    :raises HistoryError: it cannot be shown.
    """

    def __init__(self, path: Path, name: str) -> None:
        self.history = HistoryReader.of(path)
        self.pictures = Pictures()  # all are in the history
        self.tree = StateTree()
        self.scripts: Dict[str, Path] = {}
        self.missing: List[str] = []
        """Panels that are not on this computer, with the reason."""
        try:
            self._read(path, name)
        except concurrent.futures.TimeoutError as error:
            raise HistoryError(f"{path} did not answer within {STARTUP:.0f} s") from error
        except HistoryError:
            self.history.close()
            raise

    @property
    def checked_at(self) -> float:
        """The server asks whether what it shows is up to date."""
        return time.monotonic()

    def report(self, event: Event) -> None:
        """Nothing is added to it."""

    def stop(self) -> None:
        """Closes the file."""
        self.history.close()

    def _read(self, path: Path, name: str) -> None:
        newest = self.history.page(limit=NEWEST).result(STARTUP)
        runs = self.history.runs().result(STARTUP)
        found = (self.history.readable(run["run"]).result(STARTUP) for run in runs[::-1])
        try:
            meta = last_state(next(filter(None, found), None))["meta"]
            panels = [panel for panel in map(self._panel, meta["panels"]) if panel]
        except (ValueError, LookupError, TypeError) as error:
            raise HistoryError(f"{path} is damaged: no whole state can be read") from error
        HistorySection(self.tree).add(newest)
        self.tree.put("meta", simulated=bool(meta.get("simulated")), archive=name, panels=panels)

    def _panel(self, described: Dict[str, Any]) -> Dict[str, Any]:
        # The file may come from anywhere: only what is a script of a package here is shown.
        name = str(described["name"])
        try:
            if not _NAME.match(name):
                raise ValueError("its name is empty or invalid")
            self.scripts[name] = script_file(str(described["script"]))
        except ValueError as error:
            self.missing.append(f"the panel {name!r} is left out: {error}")
            return {}
        keys = ("name", "title", "width", "script")
        return {key: described[key] for key in keys}


EXIT_MISTAKES = 2
EXIT_INTERRUPTED = 130
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextlib.contextmanager
def opened(
    path: Path, host: str, port: int, name: str = "", allowed: Sequence[str] = (), open_look: bool = False
) -> Iterator[WebServer]:
    """Serves the page of a history.

    :param path: its file, or the folder in which it is.
    :param port: wanted; if it is taken, the next free one.
    :param name: what the page calls it; empty: its folder.
    :param allowed: further names of the page.
    :param open_look: whether everybody may look who reaches it; else those who sign in as operators.
    :raises HistoryError: it cannot be shown.
    :raises HostNameError: a name is not valid.
    :raises ServerError: it cannot be served.
    """
    folder = path if os.path.isdir(path) else path.parent if path.name == FILE else path
    archive = Archive(path, name or _shown(folder))
    try:
        operators = None if open_look or is_loopback(host) else Operators(default_path())
        access = WebAccess(host, allowed, operators, setting="--allowed-host ", open_look=open_look)
        server = WebServer(archive, access, None, host, port, archive.scripts)
        server.start()
        try:
            for missing in archive.missing:
                print(f"open: {missing}", file=sys.stderr)
            yield server
        finally:
            server.stop()
    except OperatorsError as error:
        raise ServerError(str(error)) from error
    finally:
        archive.stop()


def _shown(path: Path) -> str:
    name = os.path.relpath(path)
    return str(path.resolve()) if name.startswith("..") else name


def wait_for_end(key: bool) -> None:
    """Waits for a signal that ends processes.

    :param key: whether a key in the terminal ends it, too.
    """
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    # A handler of Python does not run once the wait has begun; this is written at the signal itself.
    woken = signal.set_wakeup_fd(writing)
    keys = _single_keys() if key else contextlib.nullcontext()
    try:
        with handled(dict.fromkeys(SIGNALS, lambda *_: None)), keys:
            ready: Iterable[object] = ()
            while sys.stdin not in ready:
                ready, _, _ = select.select([reading, sys.stdin] if key else [reading], [], [])
                if reading in ready and set(os.read(reading, 64)).intersection(SIGNALS):
                    break
    finally:
        signal.set_wakeup_fd(woken)
        os.close(reading)
        os.close(writing)


@contextlib.contextmanager
def _single_keys() -> Iterator[None]:
    before = termios.tcgetattr(sys.stdin)
    try:
        tty.setcbreak(sys.stdin)
        yield
        termios.tcflush(sys.stdin, termios.TCIFLUSH)
    finally:
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, before)


def main() -> int:
    """Serves until Ctrl-C; returns the exit code: 0, 2 for a mistake, 130: ended while it read a bag."""
    given = _arguments()
    try:
        with contextlib.ExitStack() as ends:
            bag = as_bag(given.path)
            if bag is not None:
                file, name = ends.enter_context(history_of(bag, given.into)), _shown(bag)
            elif given.into is not None:
                raise BagError(f"--into is for a bag; {given.path} is a history already")
            else:
                file, name = given.path, ""
            server = ends.enter_context(
                opened(file, given.host, given.port, name, given.allowed_host, given.open_look)
            )
            print(f"{server.address}  (Ctrl-C ends it)", flush=True)
            wait_for_end(key=False)
    except (HistoryError, ServerError, BagError, HostNameError) as error:
        print(f"open: {error}", file=sys.stderr)
        return EXIT_MISTAKES
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED
    return 0


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="rosrun merlin_monitor open",
        description="Shows a run that has ended, as the page showed it then. Ctrl-C ends it.",
    )
    parser.add_argument(
        "path",
        type=Path,
        help="results folder of a run that had a monitor, or its history file; or a bag of record:=true",
    )
    parser.add_argument("--host", default="127.0.0.1", help="address to serve on (%(default)s)")
    parser.add_argument(
        "--port", type=int, default=8080, help="if it is taken, the next free one (%(default)s)"
    )
    parser.add_argument(
        "--allowed-host", action="append", default=[], metavar="NAME", help="further name of the page"
    )
    parser.add_argument(
        "--open-look",
        action="store_true",
        help="with another host than this machine: everybody who reaches the page sees it without signing in",
    )
    parser.add_argument(
        "--into", type=Path, metavar="FOLDER", help="where the history of a bag is kept; else it is not kept"
    )
    given = parser.parse_args()
    if not 0 <= given.port <= 65535:
        parser.error("--port is 0 to 65535")
    return given

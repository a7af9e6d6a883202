"""A history that is shown as the page shows the past: nothing in it changes any more. Without ROS."""

import concurrent.futures
import re
import time
from pathlib import Path
from typing import Any, Dict, List

from merlin_monitor.history.history_file import HistoryError
from merlin_monitor.history.history_reader import HistoryReader
from merlin_monitor.history.pictures import Pictures
from merlin_monitor.panel_scripts import script_file
from merlin_monitor.state.history_events import Event
from merlin_monitor.state.history_store import NEWEST, HistorySection
from merlin_monitor.state.recorder import last_state
from merlin_monitor.state.state_tree import StateTree

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
        last = self.history.segment(runs[-1]["run"], runs[-1]["ended"]).result(STARTUP)
        try:
            meta = last_state(last)["meta"]
            panels = [panel for panel in map(self._panel, meta["panels"]) if panel]
        except (ValueError, LookupError, TypeError) as error:
            raise HistoryError(f"{path} is damaged: its last segment cannot be read") from error
        HistorySection(self.tree).add(newest)
        self.tree.set("meta", "simulated", bool(meta.get("simulated")))
        self.tree.set("meta", "archive", name)
        self.tree.set("meta", "panels", panels)

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

# SPDX-License-Identifier: Apache-2.0
"""What the fleet's page shows, kept by a thread of its own from the hub's changes."""

import sys
import threading
import time
import traceback
from typing import Any, Dict, List

from merlin_fleet.fleet_client import FleetClient
from merlin_fleet.fleet_shown import shown
from merlin_monitor.access.operators import Operators
from merlin_monitor.history.pictures import Pictures
from merlin_monitor.state.history_events import Event
from merlin_monitor.state.state_tree import StateTree

MOST = 200  # goals that are listed
GATHER = 0.1  # s between two drawings: many changes are drawn together
BEAT = 0.5  # s after which the page learns that nothing has changed, and that this is known
_SHOWN = {"now": ("", "fleet_now"), "control": ("Control", "fleet_send"), "fleet": ("Fleet", "fleet")}
#: Panels, as the page gets them: its keys lead to `now` and `control`.
PANELS: List[Dict[str, Any]] = [
    {"name": name, "title": title, "width": 12, "script": f"package://merlin_fleet/web/{file}.js"}
    for name, (title, file) in _SHOWN.items()
]


class FleetPage:
    """Stands where a :class:`merlin_monitor.state.monitor_model.MonitorModel` stands otherwise.

    :param client: of the fleet; what it calls after each change is replaced.
    :param operators: may send and cancel goals.
    :param open_stop: whether everybody who reaches the page may stop robots.
    """

    history = None  # the fleet's past is in the hub

    def __init__(self, client: FleetClient, operators: Operators, open_stop: bool = True) -> None:
        self._client = client
        self._operators = operators
        self.tree = StateTree()
        self.pictures = Pictures()
        self.checked_at = float("-inf")
        """When this thread last showed that it lives, s of ``time.monotonic``: else the page greys."""
        self._trouble = ""
        self._changed = threading.Event()
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._work, name="fleet page", daemon=True)
        self.tree.put("meta", robot=client.fleet, simulated=False, started=time.time(), panels=PANELS)
        # There is no button that stops all robots: each has its own.
        self.tree.put("meta", stops=False, open_stop=open_stop)
        self.tree.set("fleet", "controls", True)

    def start(self) -> None:
        """Shows what is known, and follows it from now on."""
        self._show()
        self._client.listen(self._changed.set)
        self._changed.set()  # what has changed in between
        self._thread.start()

    def stop(self) -> None:
        """Ends the thread."""
        self._stopped.set()
        self._changed.set()
        if self._thread.is_alive():
            self._thread.join(2.0)

    def report(self, event: Event) -> None:
        """No history is kept; the server's log has it."""

    def _work(self) -> None:
        while not self._stopped.wait(GATHER):
            try:
                if self._changed.wait(BEAT):
                    self._changed.clear()
                    self._show()
                self._check()
            except Exception:  # one strange record must not grey the page forever
                traceback.print_exc()

    def _show(self) -> None:
        for part, value in shown(self._client, MOST).items():
            self.tree.set("fleet", part, value)

    def _check(self) -> None:
        self.tree.set("meta", "time", round(time.time()))
        self.tree.set("meta", "control", bool(self._operators.names))
        if self._operators.trouble != self._trouble:
            self._trouble = self._operators.trouble
            if self._trouble:
                print(f"fleet page: {self._trouble}; the operators of before stay", file=sys.stderr)
        self.checked_at = time.monotonic()

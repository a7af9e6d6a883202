"""The section of the velocity guard: whether the base may drive, and whether the guard itself is heard."""

from typing import Any, Dict

from merlin_monitor.state.events import Event, Tell
from merlin_monitor.state.state_tree import StateTree
from merlin_monitor.text.clock_text import clock_text

GUARD = "guard"
HELD = "held"
"""Field of the section: while the base is stopped, by whom and since when; else empty."""
STATES = ("idle", "passing", "holding", "stopped")
SILENT_AFTER = 2.0  # s of wall time; the guard sends a status every 0.5 s, paused or not


class GuardSection:
    """Keeps the section ``guard`` of the state; without a guard it stays empty."""

    def __init__(self, tree: StateTree, tell: Tell) -> None:
        self._tree = tree
        self._tell = tell
        self._shown: Dict[str, Any] = {}
        self._heard = 0.0

    def status(self, message: Any, at: float, wall: float) -> None:
        """Takes a message with the fields of merlin_msgs/GuardStatus.

        :param at: s of ROS time.
        :param wall: s of ``time.monotonic``.
        """
        self._heard = wall
        known = message.state < len(STATES)
        state = STATES[message.state] if known else str(message.state)
        self._show(state, message.reason, at, message.since.to_sec() or at)

    def check_silence(self, at: float, wall: float) -> None:
        """Says so when a guard that was heard is silent."""
        if self._shown and wall - self._heard > SILENT_AFTER:
            self._show("silent", "the velocity guard does not answer; nothing new drives without it", at, at)

    def _show(self, state: str, reason: str, at: float, since: float) -> None:
        shown = {
            "state": state,
            "reason": reason if state in ("holding", "stopped", "silent") else "",
            HELD: "",
        }
        if state == "stopped":
            # The guard says: stopped by …, or: stopped on ….
            _, _, by = reason.partition("stopped ")
            shown[HELD] = f"stopped and held {by or reason} since {clock_text(since)}"
        if shown == self._shown:
            return
        before, self._shown = self._shown.get("state", ""), shown
        for name, value in shown.items():
            self._tree.set(GUARD, name, value)
        if state in ("stopped", "silent") and state != before:
            self._tell(Event("guard", f"base {state}: {reason}", at))
        elif before in ("stopped", "silent") and state not in ("stopped", "silent"):
            self._tell(Event("guard", "base may drive again", at))

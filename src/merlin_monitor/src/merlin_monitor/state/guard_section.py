"""The section of the velocity guard: whether the base may drive, and whether the guard itself is heard."""

from typing import Any, Dict

from merlin_monitor.state.events import Reporter, sentence
from merlin_monitor.state.state_tree import StateTree
from merlin_monitor.text.clock_text import clock_text
from merlin_monitor.text.phrase import in_english, say

GUARD = "guard"
#: Field of the section: while the base is stopped: which client stopped it, and when; else empty.
HELD = "held"
#: The same as a phrase.
HELD_WORDS = "held_words"
STATES = ("idle", "passing", "holding", "stopped")
#: Shown by the page in its language; the guard's own reasons stay as they are.
SILENT_REASON = "the velocity guard does not answer; nothing new drives without it"
SILENT_AFTER = 2.0  # s of wall time; the guard sends a status every 0.5 s, paused or not


class GuardSection:
    """Keeps the section ``guard`` of the state; without a guard it stays empty."""

    def __init__(self, tree: StateTree, report: Reporter) -> None:
        self._tree = tree
        self._report = report
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
        self._show(state, message.reason, at, message.since.to_sec() or at, message.warning)

    def check_silence(self, at: float, wall: float) -> None:
        """Says so when a guard that was heard is silent."""
        if self._shown and wall - self._heard > SILENT_AFTER:
            self._show("silent", SILENT_REASON, at, at)

    def _show(self, state: str, reason: str, at: float, since: float, warning: str = "") -> None:
        shown: Dict[str, Any] = {
            "state": state,
            "warning": warning,
            "reason": reason if state in ("holding", "stopped", "silent") else "",
            HELD: "",
            HELD_WORDS: "",
        }
        if state == "stopped":
            # The guard says: stopped by …, or: stopped on ….
            _, _, by = reason.partition("stopped ")
            _, _, name = by.partition("by ")
            words = (
                "stopped and held by {name} since {time}" if name else "stopped and held {name} since {time}"
            )
            shown[HELD_WORDS] = say(words, name=name or by or reason, time=clock_text(since))
            shown[HELD] = in_english(shown[HELD_WORDS])
        if shown == self._shown:
            return
        if warning and warning != self._shown.get("warning"):
            self._report(sentence("guard", warning, at, "failure"))
        before, self._shown = self._shown.get("state", ""), shown
        for name, value in shown.items():
            self._tree.set(GUARD, name, value)
        if state in ("stopped", "silent") and state != before:
            held = shown[HELD_WORDS] or say(SILENT_REASON)
            said = say("the base is {held}", held=held) if shown[HELD_WORDS] else held
            self._report(sentence("guard", said, at))
        elif before in ("stopped", "silent") and state not in ("stopped", "silent"):
            self._report(sentence("guard", say("the base may drive again"), at))

# SPDX-License-Identifier: Apache-2.0
"""The section of the velocity guard: whether the base may drive, and whether the guard itself is heard."""

from typing import Any, Dict

from merlin_executor.core.base_hold import holder_of
from merlin_monitor.state.history_events import Reporter, sentence
from merlin_monitor.state.state_tree import StateTree
from merlin_monitor.text.phrase import Phrase, say
from merlin_monitor.text.request_words import name_of
from merlin_ros.work.passed_time import clock_text

GUARD = "guard"
#: Field of the section: while the base is stopped: which client stopped it, and when; else empty.
HELD_WORDS = "held_words"
#: While the guard of the only robot keeps its base from a drive, for a while: why; else empty.
KEPT = "kept"
STATES = ("idle", "passing", "holding", "stopped")
#: Shown by the page in its language; the guard's own reasons stay as they are.
SILENT_REASON = "the velocity guard does not answer; nothing new drives without it"
KEPT_AFTER = 0.5  # s of wall time; each drive begins with the moment before its owner is heard
SILENT_AFTER = 2.0  # s of wall time; the guard sends a status every 0.5 s, paused or not


class GuardSection:
    """Keeps the section ``guard`` of the state; without a guard it stays empty.

    With guards of several robots its field ``robots`` has what each says; the state is ``stopped`` when each
    base is held, ``partly`` when one is, else the worst one.
    """

    def __init__(self, tree: StateTree, report: Reporter) -> None:
        self._tree = tree
        self._report = report
        self._robots: Dict[str, Dict[str, Any]] = {}  # what is shown of each; a silent one may be empty
        self._heard: Dict[str, float] = {}
        self._holds: Dict[str, float] = {}  # robot → s of wall time since when its guard keeps its base

    def met(self, robot: str, there: bool, wall: float) -> None:
        """The guard of a robot is in the ROS graph, or no longer.

        :param wall: s of ``time.monotonic``.
        """
        if there:
            self._heard.setdefault(robot, wall)
            return
        self._heard.pop(robot, None)
        self._holds.pop(robot, None)
        if self._robots.pop(robot, None):
            self._show_all()

    def status(self, message: Any, at: float, wall: float, robot: str = "") -> None:
        """Takes a message with the fields of merlin_msgs/GuardStatus.

        :param at: s of ROS time.
        :param wall: s of ``time.monotonic``.
        :param robot: whose guard it is; empty: the one of the monitor's namespace.
        """
        self._heard[robot] = wall
        state = name_of(STATES, message.state)
        if state == "holding":
            self._holds.setdefault(robot, wall)
        else:
            self._holds.pop(robot, None)
        self._show(robot, state, message.reason, at, message.since.to_sec() or at, message.warning)
        self._show_kept(wall)

    def check_silence(self, at: float, wall: float) -> None:
        """Says so when a guard that is there is silent."""
        for robot, heard in self._heard.items():
            if wall - heard > SILENT_AFTER:
                self._show(robot, "silent", SILENT_REASON, at, at)
        self._show_kept(wall)

    def _show_kept(self, wall: float) -> None:
        (robot,) = self._robots if len(self._robots) == 1 else ("",)
        kept = wall - self._holds.get(robot, wall) >= KEPT_AFTER and len(self._robots) == 1
        why = self._robots[robot]["reason"] if kept else ""
        self._tree.set(GUARD, KEPT, why)

    def _show(self, robot: str, state: str, reason: str, at: float, since: float, warning: str = "") -> None:
        shown: Dict[str, Any] = {
            "state": state,
            "warning": warning,
            "reason": reason if state in ("holding", "stopped", "silent") else "",
            HELD_WORDS: "",
        }
        if state == "stopped":
            name = holder_of(reason)
            words = (
                "stopped and held by {name} since {time}" if name else "stopped and held {name} since {time}"
            )
            how = name or reason.partition("stopped ")[2] or reason
            shown[HELD_WORDS] = say(words, name=how, time=clock_text(since))
        before = self._robots.get(robot, {})
        if shown == before:
            return
        self._robots[robot] = shown
        self._show_all()
        if warning and warning != before.get("warning"):
            self._tell(robot, warning, at, "failure")
        held = shown[HELD_WORDS] and say("the base is {held}", held=shown[HELD_WORDS])
        said: Phrase = ""
        if state in ("stopped", "silent") and state != before.get("state"):
            said = held or say(SILENT_REASON)
        elif before.get("state") in ("stopped", "silent") and state not in ("stopped", "silent"):
            said = say("the base may drive again")
        if said:
            self._tell(robot, said, at)

    def _tell(self, robot: str, said: Phrase, at: float, mark: str = "") -> None:
        said = say("{what}: {why}", what=robot, why=said) if robot else said
        self._report(sentence("guard", said, at, mark))

    def _show_all(self) -> None:
        robots = self._robots
        first = next(iter(robots.values()), {})
        several = robots if len(robots) > 1 else {}
        states = [shown["state"] for shown in robots.values()]
        worst = ("stopped", "silent", "holding", "passing")
        state = next((each for each in worst if each in states), first.get("state", ""))
        if state == "stopped" and len(set(states)) > 1:
            state = "partly"
        held: Phrase = first.get(HELD_WORDS, "") if state == "stopped" else ""
        if several and state == "stopped":
            held = [
                say("{robot} {held}", robot=robot or "base", held=shown[HELD_WORDS])
                for robot, shown in sorted(robots.items())
            ]
        warned = [(robot, shown["warning"]) for robot, shown in sorted(robots.items()) if shown["warning"]]
        self._tree.put(
            GUARD,
            state=state,
            warning="; ".join(f"{robot}: {why}" if several else why for robot, why in warned),
            reason=next((shown["reason"] for shown in robots.values() if shown["state"] == state), ""),
            held_words=held,
            robots=dict(several),
        )

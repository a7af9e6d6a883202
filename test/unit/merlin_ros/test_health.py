# SPDX-License-Identifier: Apache-2.0
"""The health of a node goes on being published, whatever its parts say."""

import threading
from typing import Any, Callable, Dict, List

import diagnostic_updater
import pytest
import rospy
from diagnostic_updater import DiagnosticStatusWrapper

from merlin_ros import health as module
from merlin_ros.health import ENDED, STALE, WARN, Health, HealthReporter
from merlin_test import LONG


class Updater:
    """Asks the parts; publishing fails at first."""

    def __init__(self) -> None:
        self.checks: Dict[str, Callable[[Any], Any]] = {}
        self.reports: List[Any] = []
        self.error: Any = None
        self.published = threading.Event()
        self.last: List[Any] = []

    def setHardwareID(self, name: str) -> None:
        pass

    def add(self, name: str, check: Callable[[Any], Any]) -> None:
        self.checks[name] = check

    def force_update(self) -> None:
        error, self.error = self.error, None
        if error is not None:
            raise error
        self.reports += [check(DiagnosticStatusWrapper()) for check in self.checks.values()]
        self.published.set()

    def broadcast(self, level: int, message: str) -> None:
        self.last.append((level, message))


@pytest.fixture
def updater(monkeypatch: pytest.MonkeyPatch) -> Updater:
    made = Updater()
    monkeypatch.setattr(diagnostic_updater, "Updater", lambda: made)
    monkeypatch.setattr(module, "PERIOD", 0.01)
    for name in ("logerr_throttle", "on_shutdown"):
        monkeypatch.setattr(rospy, name, lambda *_: None)
    return made


def test_half_a_character_is_written_as_a_question_mark(updater: Updater) -> None:
    reporter = HealthReporter({"part": lambda: Health(WARN, "no caf\udce9", {"file": "caf\udce9"})})
    reporter.start()
    assert updater.published.wait(LONG)
    reporter.stop()
    assert updater.reports[0].message == "no caf?"
    assert updater.reports[0].values[0].value == "caf?"


@pytest.mark.parametrize("error", [ValueError("odd"), rospy.ROSSerializationException("odd")])
def test_what_could_not_be_published_is_published_again(updater: Updater, error: Exception) -> None:
    updater.error = error
    reporter = HealthReporter({"part": Health})
    reporter.start()
    assert updater.published.wait(LONG), "it was silent from then on"
    reporter.stop()


def test_a_node_that_ends_says_so_last(monkeypatch: pytest.MonkeyPatch, updater: Updater) -> None:
    monkeypatch.setattr(module, "LAST_WORD", LONG)
    reporter = HealthReporter({"part": Health})
    reporter.start()
    assert updater.published.wait(LONG)
    reporter.stop()
    said = len(updater.reports)
    assert updater.last == [(STALE, ENDED)] and len(updater.reports) == said


def test_a_check_that_hangs_does_not_hold_up_the_end(updater: Updater) -> None:
    hangs, goes_on = threading.Event(), threading.Event()

    def check() -> Health:
        hangs.set()
        goes_on.wait(LONG)
        return Health()

    reporter = HealthReporter({"part": check})
    reporter.start()
    assert hangs.wait(LONG)
    reporter.stop()
    assert not goes_on.is_set() and updater.last == []
    goes_on.set()

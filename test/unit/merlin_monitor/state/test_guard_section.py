# SPDX-License-Identifier: Apache-2.0
"""What the page says of the velocity guard."""

from merlin_msgs.msg import GuardStatus
from messages import Reported

from merlin_monitor.state.guard_section import KEPT_AFTER, SILENT_AFTER, GuardSection
from merlin_monitor.state.state_tree import StateTree
from merlin_monitor.text.phrase import in_english


def test_a_stop_is_shown_with_its_reason_until_the_release() -> None:
    tree, reported = StateTree(), Reported()
    guard = GuardSection(tree, reported)
    guard.status(GuardStatus(state=GuardStatus.PASSING), 1.0, 1.0)
    assert tree.get("guard", "state") == "passing" and not reported
    guard.status(GuardStatus(state=GuardStatus.STOPPED, reason="stopped by /monitor"), 2.0, 2.0)
    assert (tree.get("guard", "state"), tree.get("guard", "reason")) == ("stopped", "stopped by /monitor")
    guard.status(GuardStatus(state=GuardStatus.STOPPED, reason="stopped by /monitor"), 2.5, 2.5)
    guard.status(GuardStatus(state=GuardStatus.IDLE), 3.0, 3.0)
    assert (tree.get("guard", "state"), tree.get("guard", "reason")) == ("idle", "")
    assert reported.texts == [
        "the base is stopped and held by /monitor since 2.0 s",
        "the base may drive again",
    ]


def test_a_guard_that_falls_silent_is_not_shown_as_it_was() -> None:
    tree, reported = StateTree(), Reported()
    guard = GuardSection(tree, reported)
    guard.check_silence(0.0, 100.0)
    assert not reported, "there may be no guard"
    guard.status(GuardStatus(state=GuardStatus.PASSING), 1.0, 100.0)
    guard.check_silence(2.0, 100.0 + SILENT_AFTER)
    assert tree.get("guard", "state") == "passing"
    guard.check_silence(3.0, 100.1 + SILENT_AFTER)
    assert tree.get("guard", "state") == "silent"
    guard.status(GuardStatus(state=GuardStatus.IDLE), 4.0, 104.0)
    assert tree.get("guard", "state") == "idle"
    assert len(reported) == 2


def test_a_state_of_a_newer_guard_is_shown_as_it_is() -> None:
    tree = StateTree()
    GuardSection(tree, Reported()).status(GuardStatus(state=77), 1.0, 1.0)
    assert tree.get("guard", "state") == "77"


def test_what_is_wrong_with_a_drive_is_shown_while_it_is_and_reported_once() -> None:
    tree, reported = StateTree(), Reported()
    guard = GuardSection(tree, reported)
    passing = GuardStatus(state=GuardStatus.PASSING)
    stuck = GuardStatus(state=GuardStatus.PASSING, warning="/move_base drives, and the base does not move")
    for status in (passing, stuck, stuck):
        guard.status(status, 1.0, 1.0)
    assert tree.get("guard", "warning") == stuck.warning and reported.texts == [stuck.warning]
    guard.status(passing, 2.0, 2.0)
    assert tree.get("guard", "warning") == ""
    guard.status(stuck, 3.0, 3.0)
    guard.check_silence(3.0, 3.1 + SILENT_AFTER)
    assert tree.get("guard", "warning") == "" and tree.get("guard", "state") == "silent"


def test_of_several_robots_each_is_reported_and_the_state_is_that_of_all() -> None:
    tree, reported = StateTree(), Reported()
    guard = GuardSection(tree, reported)
    for robot in ("ria", "tom"):
        guard.met(robot, True, 0.0)
        guard.status(GuardStatus(state=GuardStatus.PASSING), 1.0, 1.0, robot)
    stopped = GuardStatus(state=GuardStatus.STOPPED, reason="stopped by Ana")
    guard.status(stopped, 2.0, 2.0, "ria")
    assert (tree.get("guard", "state"), tree.get("guard", "held_words")) == ("partly", "")
    assert tree.get("guard", "robots", "tom", "state") == "passing"
    guard.status(GuardStatus(state=GuardStatus.PASSING, warning="it stands"), 3.0, 3.0, "tom")
    assert tree.get("guard", "warning") == "tom: it stands"
    guard.status(stopped, 4.0, 4.0, "tom")
    assert tree.get("guard", "state") == "stopped"
    both = "ria stopped and held by Ana since 2.0 s and tom stopped and held by Ana since 4.0 s"
    assert in_english(tree.get("guard", "held_words")) == both
    guard.met("tom", False, 5.0)
    assert tree.get("guard", "robots") == {}
    assert reported.texts == [
        "ria: the base is stopped and held by Ana since 2.0 s",
        "tom: it stands",
        "tom: the base is stopped and held by Ana since 4.0 s",
    ]


def test_a_guard_that_is_there_and_was_never_heard_is_silent() -> None:
    tree = StateTree()
    guard = GuardSection(tree, Reported())
    guard.met("ria", True, 10.0)
    guard.check_silence(1.0, 10.1 + SILENT_AFTER)
    assert tree.get("guard", "state") == "silent"


def test_a_guard_that_keeps_the_base_for_a_while_says_why() -> None:
    tree = StateTree()
    guard = GuardSection(tree, Reported())
    why = "a goal of move_base must not move the base: its owner is silent"
    keeps = GuardStatus(state=GuardStatus.HOLDING, reason=why)
    guard.status(keeps, 1.0, 10.0)
    assert tree.get("guard", "kept") == "", "each drive begins so"
    guard.check_silence(1.0, 10.0 + KEPT_AFTER)
    assert tree.get("guard", "kept") == why
    guard.status(GuardStatus(state=GuardStatus.PASSING), 2.0, 11.0)
    assert tree.get("guard", "kept") == ""
    guard.status(keeps, 2.0, 12.0)
    guard.met("bob", True, 12.0)
    guard.status(GuardStatus(state=GuardStatus.PASSING), 2.0, 13.0, "bob")
    assert tree.get("guard", "kept") == "", "another one drives"


def test_of_several_robots_one_that_drives_is_enough() -> None:
    tree = StateTree()
    guard = GuardSection(tree, Reported())
    for robot, state in (("ann", GuardStatus.IDLE), ("bob", GuardStatus.PASSING), ("uwe", GuardStatus.IDLE)):
        guard.status(GuardStatus(state=state), 1.0, 1.0, robot)
    assert tree.get("guard", "state") == "passing"

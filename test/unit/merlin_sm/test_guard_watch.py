# SPDX-License-Identifier: Apache-2.0
"""Whether a drive may begin, as far as the guard is concerned."""

import threading

import pytest
from fakes.topics import Topics
from merlin_msgs.msg import GuardStatus

from merlin_ros.master.master_link import MasterSilent
from merlin_sm import guard_watch
from merlin_sm.guard_watch import SILENT, GuardWatch


@pytest.fixture
def says(monkeypatch):
    """The guard says something."""
    topics = Topics(monkeypatch)
    return lambda status: topics.send("/merlin/guard", status)


@pytest.fixture
def expect(says, monkeypatch):
    monkeypatch.setattr(guard_watch, "WAIT", 0.05)
    monkeypatch.setattr(guard_watch, "FRESH", 600.0)  # the test may stand still between word and question
    return lambda value: monkeypatch.setattr(guard_watch, "get_param", lambda *_: value)


@pytest.mark.parametrize("expected", [None, False])
def test_without_a_guard_everything_may_begin(expect, expected):
    expect(expected)
    assert GuardWatch().why_not() == ""


def test_an_expected_guard_has_to_speak(expect):
    expect(True)
    assert GuardWatch().why_not() == SILENT


@pytest.mark.parametrize("state", [GuardStatus.IDLE, GuardStatus.PASSING, GuardStatus.HOLDING])
def test_a_guard_that_speaks_lets_begin(expect, says, state):
    expect(True)
    watch = GuardWatch()
    says(GuardStatus(state=state))
    assert watch.why_not() == ""


def test_the_master_is_not_asked_about_a_guard_that_speaks(expect, says, monkeypatch):
    expect(True)
    monkeypatch.setattr(guard_watch, "get_param", lambda *_: pytest.fail("the master was asked"))
    watch = GuardWatch()
    says(GuardStatus(state=GuardStatus.IDLE))
    assert watch.why_not() == ""


def test_what_it_said_long_ago_does_not_count(expect, says, monkeypatch):
    expect(True)
    watch = GuardWatch()
    says(GuardStatus())
    monkeypatch.setattr(guard_watch, "FRESH", 0.0)
    assert watch.why_not() == SILENT


class Clock:
    now = 100.0

    def monotonic(self):
        return self.now


def test_what_waited_in_a_process_that_was_held_up_says_nothing_of_now(expect, says, monkeypatch):
    expect(True)
    clock = Clock()
    monkeypatch.setattr(guard_watch, "time", clock)
    monkeypatch.setattr(guard_watch, "FRESH", 1.5)
    watch = GuardWatch()
    says(GuardStatus())
    assert watch.why_not() == ""
    clock.now += 10.0
    for _ in range(5):  # of a guard that hung meanwhile
        says(GuardStatus())
        clock.now += 0.001
    assert watch.why_not() == SILENT
    clock.now += 0.5
    says(GuardStatus())
    assert watch.why_not() == ""


def test_a_guard_that_stopped_the_base_fails_at_once_with_its_reason(expect, says):
    expect(True)
    watch = GuardWatch()
    says(GuardStatus(state=GuardStatus.STOPPED, reason="stopped by /page"))
    assert watch.why_not() == "the velocity guard has stopped the base: stopped by /page"


def heard(**fields):
    """A status of a guard that looks after one server, and hears it."""
    return GuardStatus(**{"servers": ["/ann/move_base"], "heard": ["/ann/move_base"], **fields})


def test_a_server_that_the_guard_hears_may_drive(expect, says, monkeypatch):
    expect(True)
    monkeypatch.setattr(guard_watch, "get_param", lambda *_: pytest.fail("the master was asked"))
    watch = GuardWatch()
    says(heard())
    assert watch.why_not(server="/ann/move_base") == ""


@pytest.mark.parametrize("server", ["/move_base", "/bob/move_base", "/ann/dock"])
def test_a_server_that_the_guard_does_not_know_is_named_at_once(expect, says, monkeypatch, server):
    expect(True)
    monkeypatch.setattr(guard_watch, "WAIT", 600.0)
    watch = GuardWatch()
    says(heard())
    assert watch.why_not(server=server) == (
        f"the velocity guard passes no velocities of {server}: it is not among its motion_servers "
        "[/ann/move_base]"
    )


def test_a_server_that_the_guard_does_not_hear_is_named(expect, says):
    expect(True)
    watch = GuardWatch()
    says(heard(heard=[]))
    assert "does not hear /ann/move_base/status" in watch.why_not(server="/ann/move_base")


def test_a_guard_without_which_the_robot_may_drive_forbids_nothing(expect, says):
    expect(False)
    watch = GuardWatch()
    says(heard(heard=[]))
    assert watch.why_not(server="/ann/move_base") == watch.why_not(server="/other") == ""


def test_a_guard_that_has_just_begun_is_waited_for(expect, says, monkeypatch):
    expect(True)
    monkeypatch.setattr(guard_watch, "WAIT", 600.0)
    watch, said = GuardWatch(), []
    asked = threading.Event()

    def interrupted():
        asked.set()
        return False

    waiting = threading.Thread(target=lambda: said.append(watch.why_not(interrupted, "/ann/move_base")))
    waiting.start()
    assert asked.wait(60.0)
    says(heard(heard=[]))
    asked.clear()
    assert asked.wait(60.0), "it does not wait for a guard that has yet to hear the server"
    says(heard())
    waiting.join(60.0)
    assert said == [""]


ARRIVED = "/move_base says that it has arrived, but the velocity guard passed no velocity"


@pytest.fixture
def drive(expect, says, monkeypatch):
    """What a watch says of a drive in which it hears these statuses."""
    expect(True)
    monkeypatch.setattr(guard_watch, "LONG_DRIVE", 0.0)
    warned = []
    monkeypatch.setattr(guard_watch.rospy, "logwarn", warned.append)

    def drive(*statuses):
        watch = GuardWatch()
        for before in (GuardStatus.HOLDING, GuardStatus.PASSING):
            says(heard(state=before, reason="of another drive", moving=True))
        mark = watch.mark()
        for status in statuses:
            says(status)
        return watch.why_unmoved(mark, "/move_base"), warned

    return drive


def test_an_arrival_does_not_count_when_the_guard_held_the_base(drive):
    held = heard(state=GuardStatus.HOLDING, reason="its owner is silent")
    assert drive(held, heard(state=GuardStatus.IDLE)) == (f"{ARRIVED}: its owner is silent", [])


def test_an_arrival_without_a_velocity_is_worth_a_warning(drive):
    reason, warned = drive(heard(state=GuardStatus.PASSING), heard(state=GuardStatus.IDLE))
    assert reason == "" and len(warned) == 1 and warned[0].startswith(f"{ARRIVED}. Was the robot there")


def test_an_arrival_counts_when_the_base_moved_or_the_drive_was_short(drive, monkeypatch):
    held = heard(state=GuardStatus.HOLDING, reason="its owner is silent")
    assert drive(held, heard(state=GuardStatus.PASSING, moving=True)) == ("", [])
    monkeypatch.setattr(guard_watch, "LONG_DRIVE", 600.0)
    assert drive(held) == ("", [])


def test_an_interrupt_ends_the_wait(expect, monkeypatch):
    expect(True)
    monkeypatch.setattr(guard_watch, "WAIT", 600.0)
    watch = GuardWatch()
    interrupted = threading.Event()
    waiting = threading.Thread(target=lambda: watch.why_not(interrupted.is_set), daemon=True)
    waiting.start()
    interrupted.set()
    watch.wake()
    waiting.join(60.0)
    assert not waiting.is_alive()


def test_a_silent_master_is_named(expect, monkeypatch):
    def silent(*_):
        raise MasterSilent("cannot read the parameter")

    expect(True)
    monkeypatch.setattr(guard_watch, "get_param", silent)
    assert GuardWatch().why_not() == "cannot read the parameter"


def test_the_actions_that_move_the_base_are_known_from_the_guard(expect, says):
    expect(True)
    watch = GuardWatch()
    assert not watch.names("/ann/move_base")
    says(heard(heard=[]))
    assert watch.names("/ann/move_base") and not watch.names("/ann/speak")


def test_who_follows_the_guard_hears_it_for_so_long(expect, says):
    expect(True)
    watch, said = GuardWatch(), []
    with watch.followed(lambda status: said.append(status.reason)):
        says(heard(reason="first"))
    says(heard(reason="second"))
    assert said == ["first"]

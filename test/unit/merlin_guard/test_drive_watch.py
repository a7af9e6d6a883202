# SPDX-License-Identifier: Apache-2.0
"""What the guard says of drives that it lets pass and that go wrong."""

from merlin_guard.drive_watch import ONE_OCCURRENCE, DriveWatch
from merlin_guard.settings import GuardSettings
from merlin_guard.velocity_limits import STANDING, Velocity

BASE = ["/move_base"]
SOURCE = "/cmd_vel_in"
FORWARD = Velocity(x=0.3)
SILENT = "/move_base has an active goal and has sent no velocity on /cmd_vel_in for 5 s"
STUCK = "/move_base drives, and the base does not move: odometry stands still since 3 s"


class Drive:
    """A drive whose navigation and odometry a test moves; a look each 0.05 s, as the guard has."""

    def __init__(self):
        self.watch = DriveWatch(SOURCE, GuardSettings())
        self.world = 10.0
        self.place = 0.0

    def after(self, seconds, command=None, odometry=True, moving=False, drivers=BASE, fault="", goals=("a",)):
        warned = ""
        for _ in range(round(seconds / 0.05)):
            self.world += 0.05
            if command is not None:
                self.watch.command(command, fault, self.world)
            if odometry:
                self.place += 0.015 * moving
                self.watch.odometry((self.place, 0.0, 0.0, 1.0))
            warned = self.watch.look(drivers, goals, self.world)
        return warned


def test_a_drive_without_velocities_is_named():
    drive = Drive()
    assert drive.after(4.9) == ""
    assert drive.after(0.3) == SILENT
    assert drive.after(0.1, STANDING) == "", "a robot may wait for a person"


def test_goals_for_which_no_velocity_comes_are_named_for_their_clients():
    drive = Drive()
    drive.after(59.9)
    assert drive.watch.uncommanded == ()
    drive.after(0.3)
    assert drive.watch.uncommanded == ("a",)
    drive.after(0.1, goals=("b",))
    assert drive.watch.uncommanded == (), "it begins with each goal"
    drive.after(60.1, goals=("b",))
    assert drive.watch.uncommanded == ("b",)
    drive.after(0.1, STANDING, goals=("b",))
    assert drive.watch.uncommanded == (), "a robot may wait"
    drive.after(59.0, goals=("b",))
    drive.after(0.1, drivers=[], goals=("b",))  # the guard holds the base
    drive.after(59.0, goals=("b",))
    assert drive.watch.uncommanded == ()


def test_only_what_may_drive_is_expected_to_send():
    drive = Drive()
    assert drive.after(60.0, drivers=[]) == ""
    assert drive.after(4.9) == ""
    assert drive.after(0.3) == SILENT
    assert drive.after(0.1, drivers=[]) == ""


def test_the_world_of_a_paused_simulator_does_not_get_older():
    drive = Drive()
    drive.after(4.9)
    assert not any(drive.watch.look(BASE, ("a",), drive.world) for _ in range(1000))


def test_a_base_that_does_not_follow_is_named_until_it_does():
    drive = Drive()
    assert drive.after(2.9, FORWARD) == ""
    assert drive.after(0.3, FORWARD) == STUCK
    assert drive.after(0.2, FORWARD, moving=True) == ""
    assert drive.after(3.3, FORWARD) == STUCK
    assert drive.after(0.1, STANDING) == ""


def test_a_base_that_moves_or_turns_is_not_stuck():
    drive = Drive()
    assert drive.after(30.0, FORWARD, moving=True) == ""
    assert drive.after(30.0, Velocity(yaw=0.5), moving=True) == ""


def test_without_odometry_nothing_is_known_of_the_base():
    assert Drive().after(30.0, FORWARD, odometry=False) == ""
    drive = Drive()
    drive.after(1.0, FORWARD, moving=True)
    assert drive.after(30.0, FORWARD, odometry=False) == "", "its last word is not where the base stands now"


def test_velocities_too_small_to_move_a_base_are_no_fault():
    assert Drive().after(30.0, Velocity(x=0.01, yaw=0.02)) == ""


def test_odometry_that_is_not_a_number_is_not_taken_for_standing():
    drive = Drive()
    drive.place = float("nan")
    assert drive.after(30.0, FORWARD) == ""


def test_velocities_above_the_limits_are_counted_and_reported_once():
    drive = Drive()
    texts = {drive.after(0.05, FORWARD, moving=True, fault=f"fast: {number}") for number in range(20)}
    assert texts == {"/move_base: fast: 0"} and drive.watch.faults == 20
    assert drive.after(0.05, FORWARD, moving=True, fault="wild: 1e300") == "/move_base: fast: 0; wild: 1e300"
    assert drive.after(ONE_OCCURRENCE - 0.1, FORWARD, moving=True) == "/move_base: fast: 0; wild: 1e300"
    assert drive.after(0.5, FORWARD, moving=True) == ""
    assert drive.after(0.05, FORWARD, moving=True, fault="fast: 7") == "/move_base: fast: 7"

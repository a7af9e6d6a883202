# SPDX-License-Identifier: Apache-2.0
"""Noise that depends on nothing but seed, name and time; and the pace of time itself."""

import threading
import time

import numpy as np

from merlin_reactive.pose import Pose
from merlin_reactive.seeded_random import draw
from merlin_sim.node.pacer import Pacer
from merlin_sim.robot.diff_drive import BaseController, DriveGeometry, DriveLimits
from merlin_sim.robot.truth_localization import PoseNoise, SmoothNoise, TruthLocalization, map_to_odom


def test_draws_depend_on_seed_name_and_index_only():
    first = draw(1, "scan", 7).standard_normal(5)
    draw(1, "scan", 8).standard_normal(99)
    assert np.array_equal(first, draw(1, "scan", 7).standard_normal(5))
    for seed, name, index in ((2, "scan", 7), (1, "odom", 7), (1, "scan", 8)):
        assert not np.array_equal(first, draw(seed, name, index).standard_normal(5))


def test_smooth_noise_has_its_sigma_and_no_jumps():
    noise = SmoothNoise(3, "pose", (0.02, 1.0), 2.0)
    times = np.arange(0.0, 4000.0, 0.5)
    values = np.array([noise.at(t) for t in times])
    assert np.allclose(values.std(axis=0), [0.02, 1.0], rtol=0.1)
    for moment in (2.0, 3.7, 100.0):
        assert np.abs(noise.at(moment) - noise.at(moment - 0.01))[1] < 0.1


def test_the_believed_pose_and_the_frames_fit_together():
    truth, odometry = Pose(3.0, 2.0, 1.0), Pose(1.0, -1.0, 0.5)
    believed = TruthLocalization(PoseNoise(), 1, "r1").estimate(truth, 12.3)
    assert 0.0 < believed.distance(truth) < 0.2
    again = map_to_odom(believed, odometry).compose(odometry)
    assert again.distance(believed) < 1e-9 and abs(again.yaw - believed.yaw) < 1e-9


def test_time_runs_at_the_factor_asked_for():
    pacer = Pacer(5.0)
    began = time.monotonic()
    for _ in range(100):
        assert pacer.wait(0.01)
    assert time.monotonic() - began > 0.15
    assert pacer.achieved() > 0.0


def test_time_that_as_good_as_stands_goes_on_when_it_is_to_run_faster():
    pacer = Pacer(1.0e-12)
    assert pacer.wait(0.01)
    stepped = []
    thread = threading.Thread(target=lambda: stepped.append(pacer.wait(0.01)))
    thread.start()
    thread.join(0.05)
    assert thread.is_alive()
    pacer.set_factor(0.0)
    thread.join(60.0)
    assert stepped == [True]


def test_a_pause_holds_it_and_a_stop_ends_it():
    pacer = Pacer(0.0)
    pacer.set_paused(True)
    stepped = []
    thread = threading.Thread(target=lambda: stepped.append(pacer.wait(0.01)))
    thread.start()
    thread.join(0.05)
    assert thread.is_alive()
    pacer.set_paused(False)
    thread.join(60.0)
    assert stepped == [True]
    pacer.stop()
    assert not pacer.wait(0.01)


def test_a_pause_waits_for_the_step_under_way():
    pacer = Pacer(0.0)
    assert pacer.wait(0.01)
    pause = threading.Thread(target=pacer.set_paused, args=(True,))
    pause.start()
    pause.join(0.05)
    assert pause.is_alive() and not pacer.paused
    pacer.step_ended()
    pause.join(60.0)
    assert not pause.is_alive() and pacer.paused


def test_a_stop_ends_a_pause_whose_step_does_not_end():
    pacer = Pacer(0.0)
    assert pacer.wait(0.01)
    pause = threading.Thread(target=pacer.set_paused, args=(True,))
    pause.start()
    pacer.stop()
    pause.join(60.0)
    assert not pause.is_alive()


def test_a_step_can_be_slower_than_the_factor():
    pacer = Pacer(0.0)
    began = time.monotonic()
    for _ in range(20):
        assert pacer.wait(0.01, 1.0)
    assert time.monotonic() - began > 0.15


def test_who_drives_is_waited_for_but_not_for_ever():
    base = BaseController(DriveLimits(), DriveGeometry(), timeout=0.5)
    assert not base.neglected(0.3), "no node drives it"
    base.command(0.3, 0.0, 1.0)
    assert [base.neglected(1.0 + age) for age in (0.1, 0.2, 1.0, 1.5)] == [False, True, True, False]
    base.command(0.0, 0.0, 1.2)
    assert not base.neglected(1.4), "it got a command to stand"

# SPDX-License-Identifier: Apache-2.0
"""Pictures from the process that makes them: those of this process, whatever has become of that one."""

import dataclasses
import errno
import signal
import socket
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from merlin_reactive.pose import Pose
from merlin_sim.engine.simulation import RobotSpec, Simulation
from merlin_sim.engine.world_control import Placing
from merlin_sim.rendering.appearance import Part, Shape
from merlin_sim.rendering.picture_engine import PictureEngine
from merlin_sim.rendering.renderer import Renderer
from merlin_sim.rendering.shot import PictureError
from merlin_sim.robot.camera import CameraModel
from merlin_sim.world.world_file import load_world
from merlin_sim.world.world_model import DoorEvent, Solid
from merlin_test import LONG
from merlin_test.process_signals import hang, strike

pytestmark = pytest.mark.processes

PACKAGE = Path(__file__).resolve().parents[4] / "src" / "merlin_sim"
URDF = PACKAGE / "urdf" / "rb1.urdf"


@pytest.fixture(scope="module")
def world():
    world = load_world(PACKAGE / "worlds" / "restaurant.yaml")
    box = Solid("box", Pose(3.0, 2.0), 0.3, size=(0.3, 0.3), mass=2.0)
    door = world.doors[0]
    events = [DoorEvent(0.3, door.name, not door.open)]
    tagged = dataclasses.replace(world.objects[0], tag=7)
    return dataclasses.replace(
        world, unmapped=[*world.unmapped, box], events=events, objects=[tagged, *world.objects[1:]]
    )


@pytest.fixture
def simulate(world):
    made = []

    def make(seed=1, model=None):
        model = model or CameraModel(320, 240)
        starts = {"ann": Pose(2.4, 2.0), "bob": Pose(4.2, 2.5, 3.0)}
        specs = [RobotSpec(name, start, camera=model) for name, start in starts.items()]
        made.append(Simulation(world, specs, URDF, seed))
        return made[-1]

    yield make
    for simulation in made:
        simulation.close()


@pytest.fixture
def renderer():
    lost = []
    renderer = Renderer(lost.append)
    renderer.lost = lost
    yield renderer
    renderer.close()


def picture(renderer, simulation, name="ann"):
    return renderer.take(simulation.shot(simulation.robots[name])).result(LONG)


def check_equal(renderer, simulation):
    for name, robot in simulation.robots.items():
        here = PictureEngine().expose(simulation.shot(robot))
        assert (picture(renderer, simulation, name) == here).all(), name


def test_pictures_are_those_of_this_process_whatever_happens_in_the_world(renderer, simulate):
    simulation = simulate()
    check_equal(renderer, simulation)
    for robot, command in zip(simulation.robots.values(), ((0.3, 0.0), (0.2, 0.6))):
        robot.base.command(*command, simulation.time)
    for _ in range(40):  # a box is pushed, a door moves, people walk
        simulation.step()
    check_equal(renderer, simulation)
    simulation.control.place(Placing("new_cup", kind="cup", on="ann", pose=Pose(0.1, 0.0)))
    simulation.control.place(Placing("new_guest", kind="person", pose=Pose(3.4, 3.2)))
    simulation.control.place(Placing(simulation.world.objects[1].name, absent=True))
    for _ in range(7):
        simulation.step()
    check_equal(renderer, simulation)


def test_a_world_that_began_anew_is_seen(renderer, simulate):
    one, other = simulate(), simulate(seed=2)
    one.control.place(Placing("new_cup", kind="cup", pose=Pose(3.3, 2.0), z=0.4))
    for simulation in (one, other, one):
        check_equal(renderer, simulation)


def test_a_picture_shows_the_moment_of_its_capture(renderer, simulate):
    simulation = simulate()
    robot = simulation.robots["ann"]
    shots, expected = [], []
    for _ in range(3):
        expected.append(PictureEngine().expose(simulation.shot(robot)))
        shots.append(simulation.shot(robot))
        robot.base.command(0.0, 1.0, simulation.time)
        for _ in range(20):
            simulation.step()
    futures = [renderer.take(shot) for shot in shots]  # all at once
    for future, pixels in zip(futures, expected):
        assert (future.result(LONG) == pixels).all()
    assert (expected[0] != expected[2]).any()


def test_a_default_time_limit_of_sockets_does_not_end_the_process(renderer, simulate):
    simulation = simulate(model=CameraModel(64, 48))
    before = socket.getdefaulttimeout()
    socket.setdefaulttimeout(LONG)  # as parts of ROS do while they call the master
    try:
        first = picture(renderer, simulation)
    finally:
        socket.setdefaulttimeout(before)
    process = renderer.pid
    for _ in range(3):  # it waits for each
        assert (picture(renderer, simulation) == first).all()
    assert renderer.pid == process and renderer.lost == []


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_process_that_died_or_hangs_is_replaced(simulate, number):
    lost = []
    renderer = Renderer(lost.append, limit=1.0)
    try:
        simulation = simulate(model=CameraModel(64, 48))
        picture(renderer, simulation)
        first = renderer.pid
        strike(first, number)
        check_equal(renderer, simulation)
        assert renderer.pid != first and not Path(f"/proc/{first}").exists()
        assert len(lost) == 1 and "another one makes the picture" in lost[0], lost
    finally:
        renderer.close()


def test_what_cannot_be_drawn_fails_with_a_reason_and_the_next_picture_comes(renderer, simulate):
    simulation = simulate()
    shot = simulation.shot(simulation.robots["ann"])
    nonsense = dataclasses.replace(
        shot, looks=(*shot.looks[:-1], (Part(Shape.MESH, (1.0, 1.0, 1.0), file="missing.stl"),))
    )
    with pytest.raises(PictureError, match="cannot be made: .*missing.stl cannot be read"):
        renderer.take(nonsense).result(LONG)
    check_equal(renderer, simulation)
    assert renderer.lost == []


def test_a_renderer_that_cannot_be_loaded_is_named(renderer, simulate, tmp_path, monkeypatch):
    (tmp_path / "panda3d").mkdir()
    (tmp_path / "panda3d" / "__init__.py").touch()
    monkeypatch.syspath_prepend(tmp_path)
    simulation = simulate()
    shot = simulation.shot(simulation.robots["ann"])
    with pytest.raises(PictureError, match="cannot start: No module named 'panda3d.core'"):
        renderer.take(shot).result(LONG)


@pytest.mark.parametrize("fails", ["socket.socketpair", "os.memfd_create", "subprocess.Popen"])
def test_without_descriptors_pictures_fail_with_a_reason_until_there_are_some(
    renderer, simulate, monkeypatch, open_files, fails
):
    simulation = simulate()
    before = open_files()

    def none_left(*_, **__):
        raise OSError(errno.EMFILE, "Too many open files")

    with monkeypatch.context() as context:
        context.setattr(fails, none_left)
        for _ in range(2):
            with pytest.raises(PictureError, match="cannot be started: .*Too many open files"):
                renderer.take(simulation.shot(simulation.robots["ann"])).result(LONG)
        assert open_files() <= before
    assert renderer.take(simulation.shot(simulation.robots["ann"])).result(LONG).any()


def test_an_unforeseen_error_fails_one_picture_and_not_all_that_follow(renderer, simulate, monkeypatch):
    simulation = simulate()
    with monkeypatch.context() as context:
        context.setattr("merlin_sim.rendering.picture_worker.mmap.mmap", lambda *_, **__: 1 / 0)
        with pytest.raises(PictureError, match="ZeroDivisionError"):
            renderer.take(simulation.shot(simulation.robots["ann"])).result(LONG)
    assert renderer.take(simulation.shot(simulation.robots["ann"])).result(LONG).any()


def test_when_it_closes_pictures_that_wait_fail_and_the_process_ends(simulate):
    renderer = Renderer()
    simulation = simulate()
    shot = simulation.shot(simulation.robots["ann"])
    renderer.take(shot).result(LONG)
    process = renderer.pid
    hang(process)  # so that they wait
    waiting = [renderer.take(shot) for _ in range(3)]
    renderer.close()
    for future in [*waiting, renderer.take(shot)]:
        with pytest.raises(PictureError, match="the simulator ends"):
            future.result(LONG)
    assert not Path(f"/proc/{process}").exists()


VICTIM = """
import sys
import numpy as np
from pathlib import Path
from merlin_reactive.pose import Pose
from merlin_sim.engine.simulation import RobotSpec, Simulation
from merlin_sim.rendering.renderer import Renderer
from merlin_sim.world.world_file import load_world
package = Path(sys.argv[1])
world = load_world(package / "worlds" / "apartment.yaml")
simulation = Simulation(world, [RobotSpec("", world.starts[0])], package / "urdf" / "rb1.urdf", 1)
renderer = Renderer()
renderer.take(simulation.shot(simulation.robots[""])).result()
print(renderer.pid, flush=True)
sys.stdin.read()
"""


@pytest.mark.parametrize("stopped", [False, True], ids=["it runs", "it is stopped"])
def test_the_process_ends_with_a_simulator_that_is_killed(stopped):
    victim = subprocess.Popen(
        [sys.executable, "-c", VICTIM, str(PACKAGE)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    try:
        process = int(victim.stdout.readline().split()[-1])
        if stopped:
            hang(process)
        victim.kill()
        victim.wait()
        # Both write to one pipe, which closes with the later one.
        closed = threading.Thread(target=victim.stdout.read, daemon=True)
        closed.start()
        closed.join(LONG)
        assert not closed.is_alive()
    finally:
        victim.kill()
        victim.wait()
        victim.stdin.close()
        victim.stdout.close()

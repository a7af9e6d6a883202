# SPDX-License-Identifier: Apache-2.0
"""A motion server that hangs, is taken for dead, and goes on with its goals."""

from typing import Callable

import pytest
from motion_world import DRIVING, World

from merlin_guard.motion_server import ACTIVE


def stop_and_release(world: World) -> None:
    world.do(world.permit.stop("by hand", world.now))
    world.do(world.permit.release(world.now))


@pytest.mark.parametrize("seconds", [5.0, 16.0])  # silent, and counted as dead
@pytest.mark.parametrize(
    "act",
    [
        stop_and_release,
        lambda world: world.do(world.permit.halt("halted", world.now)),
        lambda world: world.cancel("a"),
        lambda world: world.cancel(),
        lambda world: world.do(world.permit.stop("by hand", world.now)),
    ],
    ids=["stop and release", "halt", "cancel", "cancel of all", "stop"],
)
def test_what_ends_a_goal_while_its_server_hangs_holds_when_it_goes_on(
    act: Callable[[World], object], seconds: float
) -> None:
    world = World()
    world.after(0.2, DRIVING)
    assert world.drive()  # a foreign goal
    world.after(seconds)
    act(world)
    asked = len(world.cancels)
    world.after(3.0)  # longer than a cancel may take
    world.status(*DRIVING)
    assert not world.drive()
    world.after(1.0, DRIVING)
    assert not world.drive() and len(world.cancels) > asked
    world.after(0.1, [])
    world.do(world.permit.release(world.now))
    world.after(0.1, [("b", ACTIVE)])
    assert world.drive()

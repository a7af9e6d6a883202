# SPDX-License-Identifier: Apache-2.0
"""Which robot does what, on /diagnostics."""

from types import SimpleNamespace

from merlin_actions.nodes.bridges import robots_health
from merlin_ros.health import OK, WARN


def execution(robot, text, waits=False):
    return SimpleNamespace(lane=robot, text=text, left_queue=SimpleNamespace(is_set=lambda: not waits))


def health(why, *executions):
    robots = SimpleNamespace(why_not_each=lambda: why)
    return robots_health(robots, [SimpleNamespace(executions=lambda: list(executions))])


def test_each_robot_does_its_own():
    drive, waiting = execution("bob", "(drive bob a b)"), execution("bob", "(drive bob b c)", waits=True)
    found = health({"ann": "", "bob": ""}, drive, waiting, execution("", "(print one)"))
    assert found.level == OK and found.message == "ann: waits; bob: (drive bob a b)"
    assert found.values == {"ann": "waits", "bob": "(drive bob a b)"}


def test_one_that_takes_no_actions_is_a_warning_with_the_reason():
    found = health({"ann": "robot ann is gone: its host is silent", "bob": ""})
    assert found.level == WARN
    assert found.message == "ann: robot ann is gone: its host is silent; bob: waits"
    assert health({}).level == OK

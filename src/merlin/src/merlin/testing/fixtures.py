# SPDX-License-Identifier: Apache-2.0
"""Fixtures of pytest. ``pytest_plugins = ["merlin.testing.fixtures"]`` in conftest.py brings them in."""

import logging
import os
from pathlib import Path
from typing import Callable, Dict, Iterator, List, Tuple

import pytest
import rospy

from merlin.local_names import master_uri, use_loopback
from merlin.master import Master
from merlin.testing.application import Application
from merlin.testing.simulated_robot import SimulatedRobot
from merlin_ros.node import init_node


@pytest.fixture(scope="session")
def ros_master(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A ROS master of the tests' own, at which this process is a node."""
    use_loopback()
    master = Master()
    uri = master_uri(master.port)
    folder = tmp_path_factory.mktemp("ros")
    os.environ.update(ROS_MASTER_URI=uri, ROS_HOME=str(folder), ROS_LOG_DIR=str(folder / "log"))
    init_node("test", anonymous=True)
    # pytest would show some hundred lines of these with each test that fails.
    for name in ("rosmaster", "rospy.internal"):
        logging.getLogger(name).setLevel(logging.WARNING)
    yield uri
    rospy.signal_shutdown("the tests are over")
    master.stop()


@pytest.fixture(scope="session")
def robots_of_session(ros_master: str) -> Iterator[Dict[str, SimulatedRobot]]:
    """The servers of each robot, which are started once; that of the only one has no name."""
    robots: Dict[str, SimulatedRobot] = {}
    yield robots
    for robot in robots.values():
        robot.shutdown()


@pytest.fixture
def robots(
    robots_of_session: Dict[str, SimulatedRobot], request: pytest.FixtureRequest
) -> Iterator[Callable[..., List[SimulatedRobot]]]:
    """Robots of one plan whose servers do what the test says: ``ria, tom = robots("ria", "tom")``."""

    def ready(*names: str) -> List[SimulatedRobot]:
        for name in names:
            if name not in robots_of_session:
                robots_of_session[name] = SimulatedRobot(name)
            robots_of_session[name].reset(Path(str(request.node.fspath)).parent)
        return [robots_of_session[name] for name in names]

    yield ready
    for robot in robots_of_session.values():
        robot.end_missions()


@pytest.fixture
def robot(robots: Callable[..., List[SimulatedRobot]]) -> SimulatedRobot:
    """A robot whose servers do what the test says."""
    return robots("")[0]


@pytest.fixture(scope="session")
def applications(
    ros_master: str, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Callable[..., Application]]:
    """Starts applications, at most one at a time."""
    running: Dict[Tuple[str, ...], Application] = {}
    log = Path(tmp_path_factory.mktemp("application")) / "launch.log"
    with log.open("w", encoding="utf-8") as sink:

        def start(*words: str) -> Application:
            if words not in running:
                for other in list(running):
                    running.pop(other).end()
                running[words] = Application(words, sink)
            return running[words]

        yield start
        for application in running.values():
            application.end()


@pytest.fixture
def application(applications: Callable[..., Application]) -> Callable[..., Application]:
    """Starts an application below the test, without a mission: ``application("home.launch")``.

    It is started once for all tests that name it alike; its knowledge is what it was at its start.
    """

    def ready(*words: str) -> Application:
        made = applications(*words)
        made.restore()
        return made

    return ready

# SPDX-License-Identifier: Apache-2.0
"""The node /merlin_sim: a world, its robots and its time."""

import math
import threading
from functools import partial
from pathlib import Path
from typing import Callable, Dict, Optional
from xml.etree.ElementTree import ParseError

import rospkg
import rospy
from merlin_msgs.msg import SimStatus
from merlin_msgs.srv import (
    CaptureImage,
    CaptureImageRequest,
    CaptureImageResponse,
    SetRealTimeFactor,
    SetRealTimeFactorRequest,
    SetRealTimeFactorResponse,
    SetSeed,
    SetSeedResponse,
)
from nav_msgs.msg import OccupancyGrid as GridMessage
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger, TriggerResponse
from tf2_msgs.msg import TFMessage

from merlin_ros.health import OK, WARN, Health, HealthReporter
from merlin_ros.master.master_link import bounded_master
from merlin_ros.node import run_node
from merlin_ros.parameters import ParameterError
from merlin_ros.processes.process_priority import lower_priority
from merlin_ros.publishing import publish
from merlin_ros.work.threads import start_thread
from merlin_sim.engine.physics import PhysicsError
from merlin_sim.engine.simulation import ODOMETRY_EVERY, PHYSICS_RATE, Simulation
from merlin_sim.node.pacer import Pacer
from merlin_sim.node.pending_pictures import PendingPictures
from merlin_sim.node.robot_interface import RobotInterface, grid_message
from merlin_sim.node.sim_parameters import read_parameters, read_robots
from merlin_sim.node.world_services import WorldServices
from merlin_sim.rendering.renderer import Renderer
from merlin_sim.rendering.shot import PictureError
from merlin_sim.robot.camera import CameraError
from merlin_sim.robot.truth_localization import TruthLocalization
from merlin_sim.world.survey import map_of
from merlin_sim.world.world_file import WorldError, load_world

CLOCK_PERIOD = 2  # physics steps: 50 Hz
#: Factor above which the clock comes with odometry: each of its messages wakes every node of the robot.
FAST = 2.0
BEAT = CLOCK_PERIOD * ODOMETRY_EVERY  # physics steps
KEPT_UP = 0.9  # share of the factor asked for that counts as reached
STATUS_PERIOD = 1.0  # s of wall time
NICENESS = 5  # the robot's nodes go first: a late world catches up, a late decision costs its task time


class SimulatorNode:
    """Publishes the clock, loads the world, then runs it until ROS shuts down.

    :raises ParameterError: a parameter cannot be used.
    :raises WorldError: the world cannot be used.
    """

    def __init__(self) -> None:
        self._parameters = read_parameters()
        _refuse_second_clock()
        self._achieved = 0.0  # real-time factor of the last second
        self._pacer = Pacer(self._parameters.real_time_factor)
        self._clock = rospy.Publisher("/clock", Clock, latch=True, queue_size=10)
        self._status = rospy.Publisher("~status", SimStatus, queue_size=10, latch=True)
        self._tf = rospy.Publisher("/tf", TFMessage, queue_size=50)
        self._map = rospy.Publisher("/map", GridMessage, queue_size=1, latch=True)
        # One tick, so that rospy takes the time as set; it runs once the world is loaded.
        self._publish_clock(1)
        world = load_world(self._parameters.world)
        urdf = self._parameters.urdf or Path(rospkg.RosPack().get_path("merlin_sim")) / "urdf" / "rb1.urdf"
        if not Path(urdf).is_file():
            raise ParameterError(f"parameter ~urdf: there is no file {urdf}")
        self._robot_urdf = Path(urdf)
        self._seed = self._parameters.seed
        self._world = world
        self._world_lock = threading.Lock()  # held for each step of the world and its reset
        self._begun = 0  # physics steps on the clock when this world began
        specs = read_robots(world)
        try:
            self.simulation = Simulation(world, specs, self._robot_urdf, self._seed)
        except (ParseError, KeyError, PhysicsError) as error:
            raise ParameterError(
                f"parameter ~urdf: {urdf} is not a robot that can be driven: {error}"
            ) from error
        self._renderer = Renderer(lambda text: rospy.logwarn(f"merlin_sim: {text}"))
        self.pictures = PendingPictures(self._renderer, self._parameters.camera_latency)
        self._robots: Dict[str, RobotInterface] = {}
        for robot in self.simulation.robots.values():
            start = robot.spec.start
            # For a particle filter: where the robot was switched on.
            rospy.set_param(
                f"/{robot.spec.name}/start_pose".replace("//", "/"),
                {"x": start.x, "y": start.y, "yaw": start.yaw},
            )
            localization = self._localization(robot.spec.name)
            self._robots[robot.spec.name] = RobotInterface(
                self.simulation, robot, localization, self.pictures, self._parameters.camera_rate
            )
        self._grid = map_of(world)
        self._map.publish(grid_message(self._grid, _time(1)))
        self._stopped = threading.Event()
        rospy.on_shutdown(self._stop)
        # Services come last: a client that waited for one may call it at once.
        self._world_services = WorldServices(self._world_lock, self._now, self.simulation)
        self._services = [
            rospy.Service("~set_real_time_factor", SetRealTimeFactor, self._set_factor),
            rospy.Service("~pause", Trigger, lambda _: self._set_paused(True)),
            rospy.Service("~resume", Trigger, lambda _: self._set_paused(False)),
        ]
        for name in self._robots:
            topic = f"/{name}/camera/capture".replace("//", "/")
            self._services.append(rospy.Service(topic, CaptureImage, partial(self._capture, name)))
        self._services += [
            rospy.Service("~reset", Trigger, lambda _: TriggerResponse(True, self._begin_anew(self._seed))),
            rospy.Service(
                "~set_seed", SetSeed, lambda its: SetSeedResponse(True, self._begin_anew(its.seed))
            ),
        ]
        names = ", ".join(robot or "(no namespace)" for robot in self.simulation.robots)
        rospy.loginfo(f"world {world.name}, seed {self._parameters.seed}, robots: {names}")

    def run(self) -> None:
        """Runs until ROS shuts down."""
        start_thread("simulator status", self._report)
        # All steps up to the clock's next beat at once: no node knows the time in between, and a process that
        # has slept has to read all of the world into the processor's caches again.
        while True:
            steps = self._clock_period - self.simulation.tick % self._clock_period
            if not self._pacer.wait(steps / PHYSICS_RATE, 1.0 if self.simulation.neglected else math.inf):
                break
            for _ in range(steps):
                self._step()
            self._pacer.step_ended()
        with self._world_lock:
            self.simulation.close()

    def _step(self) -> None:
        self.pictures.hold(_time(self._begun + self.simulation.tick + 1))
        with self._world_lock:
            self.simulation.step()
            self._publish(self.simulation.tick)

    @property
    def _clock_period(self) -> int:
        """Physics steps from one beat of the clock to the next."""
        return CLOCK_PERIOD if 0.0 < self._pacer.factor <= FAST else ODOMETRY_EVERY

    def _localization(self, robot: str) -> Optional[TruthLocalization]:
        if self._parameters.localization != "truth":
            return None
        return TruthLocalization(self._parameters.pose_noise, self._seed, robot)

    def _begin_anew(self, seed: int) -> str:
        """Resets the world to its file; time continues, so that timers and transforms of nodes stay valid.

        :return: a sentence for the client.
        """
        with self._world_lock:
            old = self.simulation
            specs = [robot.spec for robot in old.robots.values()]
            new = Simulation(self._world, specs, self._robot_urdf, seed)
            # The clock keeps its beat.
            self._begun, self.simulation = math.ceil((self._begun + old.tick) / BEAT) * BEAT, new
            self._seed = seed
            for name, robot in self.simulation.robots.items():
                self._robots[name].attach(self.simulation, robot, self._localization(name))
            self._world_services.attach(self.simulation)
            old.close()
            # Nodes that localise or plan on a map forget the old world.
            self._map.publish(grid_message(self._grid, _time(self._begun)))
        self._publish_status()
        return f"the world began anew with seed {seed}"

    def _capture(self, robot: str, _: CaptureImageRequest) -> CaptureImageResponse:
        with self._world_lock:
            try:
                capture = self._robots[robot].capture(self._now())
            except CameraError as error:
                return CaptureImageResponse(success=False, message=str(error))
            if capture.transforms:
                self._tf.publish(TFMessage(transforms=capture.transforms))
        try:
            return CaptureImageResponse(success=True, image=capture.image(), info=capture.info)
        except PictureError as error:
            return CaptureImageResponse(success=False, message=str(error))

    def _publish(self, tick: int) -> None:
        if tick % self._clock_period == 0:
            self._publish_clock(self._begun + tick)
        stamp = _time(self._begun + tick)
        transforms = [
            transform for robot in self._robots.values() for transform in robot.publish(tick, stamp)
        ]
        if transforms:
            self._tf.publish(TFMessage(transforms=transforms))
        self._world_services.publish(tick, stamp)

    def _now(self) -> rospy.Time:
        # Before the first step it is what the clock shows already: zero would not be a time.
        return _time(max(1, self._begun + self.simulation.tick))

    def _publish_clock(self, tick: int) -> None:
        self._clock.publish(Clock(clock=_time(tick)))

    def _set_factor(self, request: SetRealTimeFactorRequest) -> SetRealTimeFactorResponse:
        if not 0.0 <= request.factor < float("inf"):
            return SetRealTimeFactorResponse(
                False, f"the factor {request.factor} is not allowed: 0 (as fast as possible) or more"
            )
        self._pacer.set_factor(request.factor)
        self._publish_status()
        return SetRealTimeFactorResponse(True, f"real-time factor {request.factor:g}")

    def _set_paused(self, paused: bool) -> TriggerResponse:
        self._pacer.set_paused(paused)
        self._publish_status()
        return TriggerResponse(True, "paused" if paused else "running")

    def _report(self) -> None:
        while not self._stopped.is_set():
            self._achieved = self._pacer.achieved()
            self._publish_status()
            self._stopped.wait(STATUS_PERIOD)

    def _publish_status(self) -> None:
        paused = self._pacer.paused
        status = SimStatus(
            paused=paused,
            requested_factor=self._pacer.factor,
            achieved_factor=0.0 if paused else self._achieved,
            seed=self._seed,
        )
        status.header.stamp = self._now()
        publish(self._status, status)

    def health(self) -> Health:
        """Whether the machine keeps up with the factor asked for."""
        wanted, achieved = self._pacer.factor, self._achieved
        values = {"requested factor": wanted, "achieved factor": f"{achieved:.2f}", "seed": self._seed}
        if self._pacer.paused:
            return Health(OK, "paused", values)
        if achieved < KEPT_UP * wanted:
            return Health(WARN, f"the machine reaches factor {achieved:.2f} of {wanted:g}", values)
        return Health(OK, f"factor {achieved:.2f}", values)

    def _stop(self) -> None:
        self._stopped.set()
        self._pacer.stop()
        self._renderer.close()


def _refuse_second_clock() -> None:
    # Two clocks make time jump back and forth for every node of the master.
    for topic, nodes in bounded_master().getSystemState()[0]:
        others = [node for node in nodes if node != rospy.get_name()]
        if topic == "/clock" and others:
            raise ParameterError(f"{others[0]} already publishes /clock; one simulator per master")


def _time(tick: int) -> rospy.Time:
    return rospy.Time(tick // PHYSICS_RATE, tick % PHYSICS_RATE * (1_000_000_000 // PHYSICS_RATE))


def main() -> int:
    """The executable ``merlin_sim``; returns its exit code."""
    lower_priority(NICENESS)
    return run_node("merlin_sim", _start, WorldError)


def _start() -> Callable[[], None]:
    node = SimulatorNode()
    HealthReporter({"world": node.health, "camera": node.pictures.health}).start()
    return node.run

# SPDX-License-Identifier: Apache-2.0
"""The physical world: PyBullet without a window, filled from a world file."""

import itertools
import math
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any, Dict, List, Optional, Sequence, Set, Tuple

import numpy as np

from merlin_reactive.pose import Pose
from merlin_reactive.recognition.object_classes import PERSON
from merlin_sim.engine.bullet import BASE, links_seen, load_robot, muted_output, new_engine, place_of
from merlin_sim.rendering.appearance import WALL, Parts, floor, parts_of
from merlin_sim.rendering.shot import Shot
from merlin_sim.robot.camera import CAMERA_LINK, Camera, CameraPose
from merlin_sim.robot.diff_drive import DriveGeometry
from merlin_sim.world.world_model import Solid, World, WorldObject

with muted_output():  # the engine greets on standard output when it is imported
    import pybullet

PhysicsError = pybullet.error
_numbers = itertools.count(1)  # of the scenes of this process
WHEEL_TORQUE = 12.0  # Nm
BURIED = -50.0  # m; where things are that are not there at the moment
TOUCHES = (2, -3)  # the engine's own group and mask of what never moves by itself


class RobotBody:
    """A robot in the physical world: its wheels are driven, the rest follows."""

    def __init__(self, engine: Any, urdf: str, start: Pose, geometry: DriveGeometry) -> None:
        self._engine = engine
        self._held: Optional[Tuple[float, float]] = None  # wheel angles while it stands
        self._wheel_speeds: Optional[Tuple[float, float]] = None  # as the motors were last set
        self._pose: Optional[Pose] = None  # as asked for since it last moved
        self.body = load_robot(engine, urdf)
        joints = {}
        self._camera: Optional[int] = None
        for index in range(engine.getNumJoints(self.body)):
            info = engine.getJointInfo(self.body, index)
            joints[info[1].decode()] = index
            if info[12].decode() == CAMERA_LINK:
                self._camera = index
        self._wheels = [joints["left_wheel_joint"], joints["right_wheel_joint"]]
        for index in range(-1, engine.getNumJoints(self.body)):
            # Casters and the hull slide; only the wheels grip.
            grip = 1.0 if index in self._wheels else 0.0
            engine.changeDynamics(
                self.body, index, lateralFriction=grip, rollingFriction=0.0, restitution=0.0
            )
        # The engine places the centre of mass, not the link's origin.
        rise = engine.getDynamicsInfo(self.body, -1)[3][2]
        self._ride_height = geometry.wheel_radius + rise
        self.place(start)

    def place(self, pose: Pose) -> None:
        """Puts it somewhere, standing still."""
        turn = self._engine.getQuaternionFromEuler([0, 0, pose.yaw])
        self._engine.resetBasePositionAndOrientation(self.body, [pose.x, pose.y, self._ride_height], turn)
        self._engine.resetBaseVelocity(self.body, [0, 0, 0], [0, 0, 0])
        self.moved()

    def moved(self) -> None:
        """It may be somewhere else now."""
        self._pose = None

    def drive(self, left: float, right: float) -> None:
        """Sets the speeds of the wheels' motors, rad/s; at zero they hold where they are."""
        if (left, right) == self._wheel_speeds:
            return
        self._wheel_speeds = (left, right)
        if left == right == 0.0:
            # A motor that only regulates speed gives way to gravity, millimetres per second.
            self._held = self._held or self.wheel_angles()
            mode, targets = pybullet.POSITION_CONTROL, {"targetPositions": self._held}
        else:
            self._held = None
            mode, targets = pybullet.VELOCITY_CONTROL, {"targetVelocities": (left, right)}
        torques = [WHEEL_TORQUE, WHEEL_TORQUE]
        self._engine.setJointMotorControlArray(self.body, self._wheels, mode, forces=torques, **targets)

    def wheel_angles(self) -> Tuple[float, float]:
        """How far the left and right wheel have turned, rad."""
        states = self._engine.getJointStates(self.body, self._wheels)
        return states[0][0], states[1][0]

    def pose(self) -> Pose:
        """Where it is, in the map frame."""
        if self._pose is None:
            self._pose = _pose(*self._engine.getBasePositionAndOrientation(self.body))
        return self._pose

    def velocity(self) -> Tuple[float, float]:
        """Speed along its heading (m/s) and turning speed (rad/s)."""
        linear, angular = self._engine.getBaseVelocity(self.body)
        yaw = self.pose().yaw
        return linear[0] * math.cos(yaw) + linear[1] * math.sin(yaw), angular[2]

    def camera_pose(self) -> Optional[CameraPose]:
        """Where its camera is and how it is turned, in the map frame; None: its description has none."""
        if self._camera is None:
            return None
        state = self._engine.getLinkState(self.body, self._camera, computeForwardKinematics=True)
        turn = np.reshape(self._engine.getMatrixFromQuaternion(state[5]), (3, 3))
        return CameraPose(np.array(state[4]), turn)

    def touches(self) -> bool:
        """Whether it touches anything but the floor (body 0)."""
        return any(
            contact[2] != 0 and contact[1] != contact[2] and contact[8] < 0.001
            for contact in self._engine.getContactPoints(bodyA=self.body)
        )


class Physics:
    """Owns the engine; used by one thread at a time.

    :param step: length of a physics step, s.
    """

    def __init__(self, world: World, step: float) -> None:
        self._engine = new_engine()
        self._number = next(_numbers)
        self._seen: List[Tuple[int, int]] = []  # bodies, and their links
        self._looks: List[Parts] = []  # of those
        self._engine.setGravity(0, 0, -9.81)
        self._engine.setTimeStep(step)
        self._engine.setPhysicsEngineParameter(numSolverIterations=50)
        # What is seen is drawn elsewhere. Without it the engine makes a mesh of each shape: 8 MB for a plane.
        self._speck = self._engine.createVisualShape(pybullet.GEOM_BOX, halfExtents=[0.001, 0.001, 0.001])
        plane = self._engine.createCollisionShape(pybullet.GEOM_PLANE)
        ground = self._engine.createMultiBody(0, plane, self._speck)
        self._engine.changeDynamics(ground, -1, lateralFriction=1.0, restitution=0.0)
        self._enter(ground, floor(world.bounds()))
        self._solids: Dict[str, int] = {}
        self._robots: List[RobotBody] = []
        self._frozen: Set[str] = set()  # things with a mass that are not there
        self._untouchable: Set[str] = set()
        for solid in world.wall_solids():
            self.add(solid, kind=WALL)
        for solid in [*world.furniture, *world.unmapped]:
            self.add(solid)
        for thing in world.objects:
            self.add(thing.solid, thing.bottom, thing.kind, thing.tag)
        for person in world.people:
            self.add(person.solid(Pose(*person.path[0])), kind=PERSON)
        for door in world.doors:
            leaf = door.leaf(world.wall_thickness, world.wall_height)
            self.add(leaf)
            self.put_solid(leaf, not door.open)

    def add(self, solid: Solid, bottom: float = 0.0, kind: str = "", tag: Optional[int] = None) -> None:
        """Puts a thing into the world, `bottom` m above the floor; without mass robots cannot push it.

        :param kind, tag: what it looks like, see :func:`.appearance.parts_of`.
        """
        if solid.radius is not None:
            shape = self._engine.createCollisionShape(
                pybullet.GEOM_CYLINDER, radius=solid.radius, height=solid.height
            )
        else:
            half = [*solid.half_size, solid.height / 2]
            shape = self._engine.createCollisionShape(pybullet.GEOM_BOX, halfExtents=half)
        body = self._engine.createMultiBody(solid.mass, shape, self._speck)
        self._engine.changeDynamics(body, -1, lateralFriction=0.5, restitution=0.0)
        self._solids[solid.name] = body
        self._enter(body, parts_of(solid, kind, tag))
        self._put(body, solid.pose, bottom + solid.height / 2)

    def put_solid(self, solid: Solid, there: bool, bottom: float = 0.0) -> None:
        """Moves a thing to where it is said to stand, or out of the world."""
        body = self._solids[solid.name]
        if solid.mass and there == (solid.name in self._frozen):
            # Without a mass it does not fall forever.
            self._engine.changeDynamics(body, -1, mass=solid.mass if there else 0.0)
            self._frozen ^= {solid.name}
        self._put(body, solid.pose, bottom + solid.height / 2 if there else BURIED)
        if solid.mass:
            self._engine.resetBaseVelocity(body, [0, 0, 0], [0, 0, 0])

    def put(self, thing: WorldObject, there: bool, touchable: bool) -> None:
        """Moves an object to where it stands, or out of the world; a new one comes into it.

        :param touchable: nothing passes through it. A carried thing must not hold back its carrier.
        """
        name = thing.name
        if name not in self._solids:
            self.add(thing.solid, thing.bottom, thing.kind, thing.tag)
        body = self._solids[name]
        self._put(body, thing.solid.pose, thing.bottom + thing.solid.height / 2 if there else BURIED)
        if touchable == (name in self._untouchable):
            self._engine.setCollisionFilterGroupMask(body, -1, *(TOUCHES if touchable else (0, 0)))
            self._untouchable ^= {name}

    def let_pass(self, one: str, other: str, free: bool) -> None:
        """Whether two things may be in the same place, as a person and the chair under it."""
        self._engine.setCollisionFilterPair(self._solids[one], self._solids[other], -1, -1, int(not free))

    def place_of(self, name: str) -> Pose:
        """Where a thing is, in the map frame."""
        return _pose(*self._engine.getBasePositionAndOrientation(self._solids[name]))

    def add_robot(self, urdf: Path, start: Pose, geometry: DriveGeometry) -> RobotBody:
        """Adds a robot."""
        robot = RobotBody(self._engine, _massive_part(urdf), start, geometry)
        for link, parts in links_seen(self._engine, robot.body):
            self._enter(robot.body, parts, link)
        self._robots.append(robot)
        return robot

    def shot(self, camera: Camera, pose: CameraPose, tick: int) -> Shot:
        """What a camera sees now, for a picture that is made elsewhere."""
        return Shot(
            scene=self._number,
            looks=tuple(self._looks),
            places=np.array([place_of(self._engine, body, link) for body, link in self._seen]),
            camera=camera,
            pose=pose,
            tick=tick,
        )

    def step(self) -> None:
        """Simulates one step."""
        self._engine.stepSimulation()
        for robot in self._robots:
            robot.moved()

    def close(self) -> None:
        """Gives the engine back."""
        self._engine.disconnect()

    def _enter(self, body: int, look: Parts, link: int = BASE) -> None:
        self._seen.append((body, link))
        self._looks.append(look)

    def _put(self, body: int, pose: Pose, height: float) -> None:
        turn = self._engine.getQuaternionFromEuler([0, 0, pose.yaw])
        self._engine.resetBasePositionAndOrientation(body, [pose.x, pose.y, height], turn)


def _pose(position: Sequence[float], turn: Sequence[float]) -> Pose:
    x, y, z, w = turn
    return Pose(position[0], position[1], math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))


def _massive_part(urdf: Path) -> str:
    # The engine gives 1 kg to links without mass, such as base_footprint (REP 120) and the optical frame.
    root = ElementTree.parse(urdf).getroot()
    massless = {link.get("name") for link in root.iter("link") if link.find("inertial") is None}
    for element in list(root):
        if element.get("name") in massless or any(child.get("link") in massless for child in element):
            root.remove(element)
    return ElementTree.tostring(root, encoding="unicode")

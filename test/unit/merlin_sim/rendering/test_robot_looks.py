# SPDX-License-Identifier: Apache-2.0
"""What a robot looks like: the visual shapes of its description, where its links are."""

import math

import numpy as np
import pytest

from merlin_sim.engine.bullet import links_seen, load_robot, new_engine, place_of
from merlin_sim.rendering.appearance import Shape

ROBOT = """<robot name="r">
  <material name="green"><color rgba="0 0.5 0 1"/></material>
  <link name="base">
    <inertial><origin xyz="0.1 0.2 0.3" rpy="0 0 0.5"/><mass value="1"/>
      <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><origin xyz="0 0 0.5"/><geometry><box size="0.2 0.4 0.6"/></geometry>
      <material name="green"/></visual>
    <visual><origin xyz="1 0 0"/><geometry><mesh filename="MESH" scale="2 2 2"/></geometry></visual>
  </link>
  <link name="arm">
    <inertial><origin xyz="0.3 0 0"/><mass value="1"/>
      <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><origin xyz="0.5 0 0" rpy="0 1.5707963 0"/>
      <geometry><cylinder radius="0.1" length="1.0"/></geometry></visual>
    <visual><origin xyz="1 0 0"/><geometry><sphere radius="0.2"/></geometry></visual>
  </link>
  <joint name="shoulder" type="continuous">
    <parent link="base"/><child link="arm"/><origin xyz="0 0 1"/><axis xyz="0 0 1"/>
  </joint>
</robot>"""


@pytest.fixture
def engine():
    engine = new_engine()
    yield engine
    engine.disconnect()


def middle(engine, body, link, part):
    """Where a part's middle is in the world."""
    place = place_of(engine, body, link)
    return engine.multiplyTransforms(place[:3], place[3:], part.at, part.turn)[0]


def test_parts_are_where_the_description_and_the_joints_have_them(engine, tmp_path):
    mesh = tmp_path / "t.obj"
    mesh.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n")
    body = load_robot(engine, ROBOT.replace("MESH", str(mesh)))
    # The frame of the base at 2, 0, 0, turned to the left; the engine wants the centre of mass.
    turn = engine.getQuaternionFromEuler((0, 0, math.pi / 2))
    mass = engine.getDynamicsInfo(body, -1)[3:5]
    engine.resetBasePositionAndOrientation(body, *engine.multiplyTransforms((2, 0, 0), turn, *mass))
    engine.resetJointState(body, 0, math.pi / 2)
    links = dict(links_seen(engine, body))
    box, shown = links[-1]
    cylinder, sphere = links[0]
    assert (box.shape, shown.shape) == (Shape.BOX, Shape.MESH)
    assert (cylinder.shape, sphere.shape) == (Shape.CYLINDER, Shape.SPHERE)
    assert box.size == pytest.approx((0.2, 0.4, 0.6)) and box.color == pytest.approx((0, 0.5, 0))
    assert shown.size == pytest.approx((2, 2, 2)) and shown.file == str(mesh)
    assert cylinder.size == pytest.approx((0.2, 0.2, 1.0)) and sphere.size == pytest.approx((0.4,) * 3)
    assert middle(engine, body, -1, box) == pytest.approx((2, 0, 0.5), abs=1e-6)
    assert middle(engine, body, -1, shown) == pytest.approx((2, 1, 0), abs=1e-6)
    assert middle(engine, body, 0, cylinder) == pytest.approx((1.5, 0, 1), abs=1e-6)
    assert middle(engine, body, 0, sphere) == pytest.approx((1, 0, 1), abs=1e-6)
    # The cylinder lies along the arm.
    along = np.reshape(engine.getMatrixFromQuaternion(cylinder.turn), (3, 3))[:, 2]
    assert along == pytest.approx((1, 0, 0), abs=1e-6)

# SPDX-License-Identifier: Apache-2.0
"""The world in motion: physics, scene, simulation step. Knows no ROS and no wall time."""

# SPDX-License-Identifier: Apache-2.0
"""Writes the package of a new application: `rosrun merlin new`. Without ROS."""

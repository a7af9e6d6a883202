# SPDX-License-Identifier: Apache-2.0
"""Planners: engines, commands, their output; no ROS."""

# SPDX-License-Identifier: Apache-2.0
"""The components of the planning system, as ROS nodes."""

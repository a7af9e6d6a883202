# SPDX-License-Identifier: Apache-2.0
"""A robot of the fleet over ROS."""

# SPDX-License-Identifier: Apache-2.0
"""A node's life with, without and after its ROS master."""

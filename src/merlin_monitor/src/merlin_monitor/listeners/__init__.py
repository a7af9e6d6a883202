# SPDX-License-Identifier: Apache-2.0
"""What panels are made of, and what all of them share: the watch of the ROS graph, the pulse."""

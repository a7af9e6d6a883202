# SPDX-License-Identifier: Apache-2.0
"""What is shown, without ROS nodes: a tree of plain values, kept by one section for each panel."""

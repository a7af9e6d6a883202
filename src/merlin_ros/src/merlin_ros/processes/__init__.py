# SPDX-License-Identifier: Apache-2.0
"""What a process has started: children that work for it, all below it, and which goes first. Without ROS."""

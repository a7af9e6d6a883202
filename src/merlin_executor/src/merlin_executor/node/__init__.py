# SPDX-License-Identifier: Apache-2.0
"""The Executor as a node: carries the decisions of `core` out over ROS."""

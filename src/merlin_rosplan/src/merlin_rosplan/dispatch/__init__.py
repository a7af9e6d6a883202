# SPDX-License-Identifier: Apache-2.0
"""Plan graphs and what is dispatched when; no ROS."""

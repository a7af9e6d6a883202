# SPDX-License-Identifier: Apache-2.0
"""The process in which a planning runs, and its end; no ROS."""

# SPDX-License-Identifier: Apache-2.0
"""PDDL read, evaluated and written; no ROS."""

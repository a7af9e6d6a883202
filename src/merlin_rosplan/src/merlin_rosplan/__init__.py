# SPDX-License-Identifier: Apache-2.0
"""The planning system: ROSPlan's node interfaces over a core without ROS."""

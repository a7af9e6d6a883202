# SPDX-License-Identifier: Apache-2.0
"""What the steps of a plan that are still to come need of the world. Without ROS."""

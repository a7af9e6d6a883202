# SPDX-License-Identifier: Apache-2.0
"""Tables that show how well the reactive layer works in simulated worlds, measured without ROS."""

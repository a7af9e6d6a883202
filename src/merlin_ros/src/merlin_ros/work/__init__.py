# SPDX-License-Identifier: Apache-2.0
"""What all work that runs for a client shares, without ROS."""

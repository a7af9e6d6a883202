# SPDX-License-Identifier: Apache-2.0
"""The node that answers questions over ROS."""

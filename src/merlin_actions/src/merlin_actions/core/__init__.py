# SPDX-License-Identifier: Apache-2.0
"""What action interfaces and hosts decide. Without ROS."""

# SPDX-License-Identifier: Apache-2.0
"""What things look like, and the process that makes pictures of them. Knows no ROS."""

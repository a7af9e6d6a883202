# SPDX-License-Identifier: Apache-2.0
"""Access to the page: hosts, origins, operators and their tokens. Without ROS."""

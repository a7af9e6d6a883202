# SPDX-License-Identifier: Apache-2.0
"""The knowledge base's state and its changes; no ROS."""

# SPDX-License-Identifier: Apache-2.0
"""The knowledge base's file; no ROS."""
